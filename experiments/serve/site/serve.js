"use strict";
(() => {
  const about = document.querySelector("meta[name=sinan]"), list = document.getElementById("jobs");
  const problem = document.getElementById("problem"), form = document.getElementById("drop");
  const input = document.getElementById("file"), limit = Number(about.dataset.limit);
  const headers = { "X-Sinan": about.content };
  const sending = new Map();
  const state = document.getElementById("status");
  let timer = null;

  const make = (name, into, text, kind) => {
    const one = document.createElement(name);
    if (text) one.textContent = text;
    if (kind) one.className = kind;
    into.appendChild(one);
    return one;
  };
  const told = size => size < 2 ** 20 ? `${Math.ceil(size / 1024)} kB` : `${(size / 2 ** 20).toFixed(1)} MB`;
  const complain = text => { problem.textContent = text; problem.hidden = !text; };
  const remove = async job => {
    if (job.request) job.request.abort();
    else await fetch(`/jobs/${job.id}`, { method: "DELETE", headers });
    look();
  };

  // the entry of a job in the list; made anew only where more than its clock has changed
  const items = new Map();
  const entry = job => {
    const item = document.createElement("li"), end = job.state === "done" || job.state === "failed" ? "remove" : "stop";
    item.dataset.state = job.state;
    make("b", item, job.name);
    if (job.state === "done") {
      const line = make("p", item);
      make("span", line, job.verdict.replace("_", " "), `verdict ${job.verdict}`);
      line.append(job.headline);
      const links = make("p", item);
      make("a", links, "Read the page").href = `/jobs/${job.id}/page`;
      make("a", links, "numbers (JSON)").href = `/jobs/${job.id}/report.json`;
    } else if (job.state === "failed") make("p", item, job.why, "bad");
    else if (job.state !== "waiting") make("progress", item).setAttribute("aria-label", `progress of ${job.name}`);
    const foot = make("p", item, "", "soft");
    make("span", foot);
    const stop = make("button", foot, end);
    stop.type = "button";
    stop.setAttribute("aria-label", `${end} ${job.name}`);
    stop.onclick = () => remove(job);
    return item;
  };
  const draw = jobs => {
    const all = [...jobs, ...sending.values()].reverse(), done = jobs.filter(job => job.state === "done" || job.state === "failed");
    document.getElementById("none").hidden = all.length > 0;
    const text = all.length ? `${done.length} of ${all.length} done` : "";
    if (state.textContent !== text) state.textContent = text;
    for (const job of all) {
      const { seconds, request, share, ...rest } = job, key = JSON.stringify(rest), own = request || job.id;
      if (items.get(own)?.key !== key) items.set(own, { key, item: entry(job) });
      const { item } = items.get(own), bar = item.querySelector("progress");
      if (bar && share !== undefined) bar.value = share;
      const how = { waiting: "waits for its turn", sending: "is being copied", running: `${job.stage}, ${Math.round(seconds)} s` };
      item.querySelector("p.soft span").textContent = `${told(job.size)}, ${how[job.state] || `${Math.round(seconds)} s`} `;
    }
    const wanted = all.map(job => items.get(job.request || job.id).item);
    if (wanted.length !== list.children.length || wanted.some((item, k) => list.children[k] !== item)) list.replaceChildren(...wanted);
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
    if (file.size > limit) return complain(`${file.name}: ${told(file.size)}; at most ${told(limit)} are taken (--size).`);
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
