"use strict";
(() => {
  const about = document.querySelector("meta[name=sinan]"), list = document.getElementById("jobs");
  const problem = document.getElementById("problem"), form = document.getElementById("drop");
  const input = document.getElementById("file"), limit = Number(about.dataset.limit);
  const headers = { "X-Sinan": about.content };
  const sending = new Map();
  let timer = null, shown = "";

  const make = (name, into, text, kind) => {
    const one = document.createElement(name);
    if (text) one.textContent = text;
    if (kind) one.className = kind;
    into.appendChild(one);
    return one;
  };
  const megabytes = size => `${(size / 2 ** 20).toFixed(size < 2 ** 20 ? 2 : 1)} MB`;
  const complain = text => { problem.textContent = text; problem.hidden = !text; };

  const drawn = (job, into) => {
    const item = make("li", into);
    item.dataset.state = job.state;
    make("b", item, job.name);
    const end = { done: "remove", failed: "remove" }[job.state] || "stop";
    if (job.state === "done") {
      const line = make("p", item);
      make("span", line, job.verdict.replace("_", " "), `verdict ${job.verdict}`);
      line.append(job.headline);
      const links = make("p", item);
      make("a", links, "Read the page").href = `/jobs/${job.id}/page`;
      make("a", links, "numbers (JSON)").href = `/jobs/${job.id}/report.json`;
    } else if (job.state === "failed") make("p", item, job.why, "bad");
    else {
      const bar = make("progress", item);
      if (job.share !== undefined) { bar.max = 1; bar.value = job.share; }
      bar.setAttribute("aria-label", `progress of ${job.name}`);
    }
    const told = { waiting: "waits for its turn", running: `${job.stage}, ${Math.round(job.seconds)} s`,
      sending: "is being copied", done: `${Math.round(job.seconds)} s`, failed: `${Math.round(job.seconds)} s` }[job.state];
    const foot = make("p", item, `${megabytes(job.size)}, ${told} `, "soft");
    const stop = make("button", foot, end);
    stop.type = "button";
    stop.setAttribute("aria-label", `${end} ${job.name}`);
    stop.onclick = async () => {
      if (job.request) job.request.abort();
      else await fetch(`/jobs/${job.id}`, { method: "DELETE", headers });
      look();
    };
  };
  const draw = jobs => {
    const all = [...jobs, ...sending.values()], now = JSON.stringify(all.map(({ request, ...rest }) => rest));
    document.getElementById("none").hidden = all.length > 0;
    if (now === shown) return;
    shown = now;
    list.replaceChildren();
    for (const job of all.reverse()) drawn(job, list);
  };
  const look = async () => {
    clearTimeout(timer);
    let jobs = [];
    try { jobs = (await (await fetch("/jobs")).json()).jobs; }
    catch { complain("The command that serves this page has ended."); return; }
    draw(jobs);
    if (sending.size || jobs.some(job => job.state === "waiting" || job.state === "running")) timer = setTimeout(look, 700);
  };
  const send = file => {
    if (file.size > limit) return complain(`${file.name}: ${megabytes(file.size)}; at most ${megabytes(limit)} are taken (--size).`);
    if (file.size === 0) return complain(`${file.name}: an empty file.`);
    const request = new XMLHttpRequest(), job = { name: file.name, size: file.size, state: "sending", share: 0, request };
    sending.set(request, job);
    request.open("POST", `/jobs?name=${encodeURIComponent(file.name)}`);
    request.setRequestHeader("X-Sinan", about.content);
    request.upload.onprogress = event => { job.share = event.loaded / file.size; };
    request.onloadend = () => {
      sending.delete(request);
      if (request.status !== 201) {
        let why = "it could not be copied";
        try { why = JSON.parse(request.responseText).why; } catch { /* nothing was answered */ }
        complain(`${file.name}: ${why}.`);
      }
      look();
    };
    request.send(file);
    return look();
  };
  const take = files => { complain(""); for (const file of files) send(file); };
  input.onchange = () => { take([...input.files]); input.value = ""; };
  form.onsubmit = () => false;
  addEventListener("dragover", event => { event.preventDefault(); form.classList.add("over"); });
  addEventListener("dragleave", () => form.classList.remove("over"));
  addEventListener("drop", event => { event.preventDefault(); form.classList.remove("over"); take([...event.dataTransfer.files]); });
  look();
})();
