"use strict";
(() => {
  const W = 1000, H = 200, GONE = 65535;
  const make = (name, into, text, kind) => {
    const one = document.createElement(name);
    if (text) one.textContent = text;
    if (kind) one.className = kind;
    if (into) into.appendChild(one);
    return one;
  };
  const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer;
  const minus = text => text.replace(/-/g, "\u2212");
  const n = v => v.toFixed(1).replace(/\.0$/, "");

  const ticks = (low, high, about) => {
    const rough = (high - low) / about, power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].find(k => k * power >= rough * 0.999) * power;
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
    const large = Math.max(0, ...found.map(Math.abs));
    const written = v => digits > 6 || large >= 1e5 ? String(Number(v.toPrecision(4))) : v.toFixed(digits);
    return found.map(v => [v, minus(written(v))]);
  };
  const decades = (low, high, about) => {
    const few = 3 * (high - low) <= about + 1, every = Math.max(1, Math.ceil((high - low) / about)), found = [];
    for (let k = Math.floor(low); k <= high + 1e-9; k++)
      for (const part of few ? [0, Math.log10(2), Math.log10(5)] : [0])
        if (k + part >= low - 1e-9 && k + part <= high + 1e-9 && (few || k % every === 0)) found.push(k + part);
    return found.map(v => [v, String(Number((10 ** v).toPrecision(3)))]);
  };
  // the first place in a rising array that is not below a value
  const place = (x, value) => {
    let a = 0, b = x.length;
    while (a < b) { const m = (a + b) >> 1; if (x[m] < value) a = m + 1; else b = m; }
    return a;
  };

  class Panel {
    constructor(figure, data, clocks) {
      this.figure = figure; this.axis = data.axis; this.log = data.log; this.robust = data.robust;
      this.span = data.span; this.origin = data.origin;
      this.svg = figure.querySelector("svg.area");
      this.paths = [...this.svg.querySelectorAll(":scope > path")];
      this.curves = data.curves.map(c => ({ kind: c.kind, x: clocks[c.x], low: c.low, scale: c.scale, pairs: c.pairs,
        y: new Uint16Array(bytes(c.y)) }));
      this.keys = new Map([...figure.querySelectorAll(".key[data-curve]")]
        .map(key => [Number(key.dataset.curve), make("output", key)]));
      this.shown = false; this.stale = false;
    }
    within(curve, [from, to]) {
      const a = Math.max(0, place(curve.x, from - this.origin) - 1);
      return [a, Math.min(curve.x.length, place(curve.x, to - this.origin) + 1)];
    }
    values(view) {
      let low = Infinity, high = -Infinity;
      const whole = view[0] <= this.span[0] && view[1] >= this.span[1], all = [], bounds = [];
      for (const c of this.curves) {
        const [a, b] = this.within(c, view);
        for (let k = a; k < b; k++) {
          if (c.y[k] === GONE) continue;
          const v = c.low + c.scale * c.y[k];
          if (v < low) low = v;
          if (v > high) high = v;
          if (whole && this.robust) (c.kind === "bound" ? bounds : all).push(Math.abs(v));
        }
      }
      if (all.length) {
        const at = (values, share) => values.length ? values.sort((p, q) => p - q)[Math.floor(share * (values.length - 1))] : 0;
        const reach = 1.5 * Math.max(at(all, 0.97), at(bounds, 0.5));
        low = Math.max(low, -reach); high = Math.min(high, reach);
      }
      if (low === Infinity) return [0, 1];
      if (!(high > low)) { const room = Math.abs(high) * 0.1 || 1; return [low - room, high + room]; }
      return [low - 0.06 * (high - low), high + 0.06 * (high - low)];
    }
    draw(view) {
      if (!this.shown) { this.stale = true; return; }
      this.stale = false;
      const [low, high] = this.values(view), fx = W / (view[1] - view[0]), fy = H / (high - low);
      this.curves.forEach((c, number) => {
        const parts = [], most = 1600, dots = c.kind === "dots";
        let [a, b] = this.within(c, view), each = Math.max(1, Math.ceil((b - a) / most));
        if (dots && c.pairs) { a -= a % 2; each = Math.max(2, each + each % 2); }
        let up = true;
        const point = k => {
          const gone = c.y[k] === GONE;
          if (!gone) {
            const u = n((c.x[k] + this.origin - view[0]) * fx);
            const v = n(Math.max(-H, Math.min(2 * H, H - (c.low + c.scale * c.y[k] - low) * fy)));
            parts.push(dots ? `M${u} ${v}h0` : `${up ? "M" : "L"}${u} ${v}`);
          }
          up = gone;
        };
        for (let k = a; k < b; k += each) {
          if (each === 1) { point(k); continue; }
          let least = -1, most_ = -1, gap = -1;
          for (let j = k; j < Math.min(b, k + each); j++) {
            if (c.y[j] === GONE) { gap = j; continue; }
            if (least < 0 || c.y[j] < c.y[least]) least = j;
            if (most_ < 0 || c.y[j] > c.y[most_]) most_ = j;
          }
          if (dots && least >= 0) {
            point(least);
            parts.push(`V${n(H - (c.low + c.scale * c.y[most_] - low) * fy)}`);
            continue;
          }
          for (const j of least < most_ ? [least, most_] : [most_, least]) if (j >= 0) point(j);
          if (gap >= 0) up = true;
        }
        this.paths[number].setAttribute("d", parts.join(""));
      });
      this.label(view, low, high);
    }
    label(view, low, high) {
      const y = this.log ? decades(low, high, 6) : ticks(low, high, 5), lines = this.svg.querySelector(".lines");
      lines.innerHTML = y.map(([v]) => `<path class="grid" d="M0 ${n(H - (v - low) / (high - low) * H)}H${W}"/>`).join("");
      labels(this.figure.querySelector(".ys"), y, v => 100 - (v - low) / (high - low) * 100, "top");
      along(this.figure, view, this.log);
      bands(this.svg, view, H);
    }
    read(x) {
      for (const [number, output] of this.keys) {
        const c = this.curves[number], at = x - this.origin;
        let k = place(c.x, at);
        if (k > 0 && (k === c.x.length || at - c.x[k - 1] < c.x[k] - at)) k--;
        const near = c.x.length && c.y[k] !== GONE;
        let v = near ? c.low + c.scale * c.y[k] : NaN;
        if (this.log) v = 10 ** v;
        output.textContent = near ? minus(String(Number(v.toPrecision(4)))) : "";
      }
    }
    clear() { for (const output of this.keys.values()) output.textContent = ""; }
  }

  const labels = (into, found, where, edge) => {
    for (const old of [...into.querySelectorAll("span:not(.unit)")]) old.remove();
    for (const [v, text] of found) {
      if (edge === "left" && where(v) > 96.5) continue;
      const one = make("span", null, text);
      one.style[edge] = `${where(v)}%`;
      into.insertBefore(one, into.querySelector(".unit"));
    }
  };
  const along = (figure, view, log) => labels(figure.querySelector(".xs"),
    log ? decades(view[0], view[1], 6) : ticks(view[0], view[1], 6), v => (v - view[0]) / (view[1] - view[0]) * 100, "left");
  const bands = (svg, view, height) => {
    for (const band of svg.querySelectorAll(".bands path")) {
      band.dataset.at ||= (() => {
        const [, a, b] = band.getAttribute("d").match(/^M(-?[\d.]+) 0H(-?[\d.]+)/);
        return `${a} ${b}`;
      })();
      const full = svg.closest(".review").full;
      const [a, b] = band.dataset.at.split(" ").map(v => (full[0] + v / W * (full[1] - full[0]) - view[0]) / (view[1] - view[0]) * W);
      band.setAttribute("d", `M${n(Math.max(-9, a))} 0H${n(Math.min(W + 9, Math.max(a, b)))}V${height}H${n(Math.max(-9, a))}Z`);
      band.style.display = b < 0 || a > W ? "none" : "";
    }
  };

  const begin = root => {
    const data = JSON.parse(root.querySelector("script.data").textContent);
    const clocks = data.clocks.map(text => new Float32Array(bytes(text)));
    const figures = [...root.querySelectorAll(".panel[data-panel]")];
    const panels = figures.map(f => new Panel(f, data.panels[f.dataset.panel], clocks));
    const strip = root.querySelector(".panel.events"), plan = root.querySelector(".panel.plan");
    const own = root.dataset.axis, unit = own === "time" ? " s" : "";
    const first = panels.find(p => p.axis === own);
    root.full = first ? first.span : [0, 1];
    const whole = {}, views = {};
    for (const p of panels) { whole[p.axis] = p.span; views[p.axis] = [...p.span]; }

    const tools = make("div", null, "", "tools"), buttons = {};
    tools.setAttribute("role", "toolbar");
    tools.setAttribute("aria-label", "zoom of all panels over time");
    for (const [text, what, act] of [["+", "closer", () => zoom(own, 0.5)], ["\u2212", "wider", () => zoom(own, 2)],
      ["\u25c0", "earlier", () => move(-0.3)], ["\u25b6", "later", () => move(0.3)], ["all", "all of it", () => show(own, whole[own])]]) {
      const one = buttons[what] = make("button", tools, text);
      one.type = "button"; one.title = what; one.setAttribute("aria-label", what); one.onclick = act;
    }
    const said = make("output", tools);
    make("span", tools, "drag to zoom, or Ctrl and the wheel; double click: all", "hint");
    const before = strip || (figures[0] && figures[0].parentNode === root ? figures[0] : null);
    root.insertBefore(tools, plan || before || root.firstChild);
    root.classList.add("live");

    const round = v => minus(v.toFixed(Math.max(0, 2 - Math.floor(Math.log10((views[own][1] - views[own][0]) || 1)))));
    const tell = () => { said.textContent = `${round(views[own][0])} to ${round(views[own][1])}${unit}`; };
    let waiting = false;
    const redraw = () => {
      if (waiting) return;
      waiting = true;
      requestAnimationFrame(() => {
        waiting = false;
        const started = performance.now();
        for (const p of panels) if (p.dirty) { p.dirty = false; p.draw(views[p.axis]); }
        if (strip) { along(strip, views[own], false); for (const svg of strip.querySelectorAll("svg")) bands(svg, views[own], 10); names(); }
        path();
        tell();
        root.dataset.redrawn = (performance.now() - started).toFixed(1);
        root.dataset.view = views[own].join(" ");
      });
    };
    const show = (axis, [a, b]) => {
      const [low, high] = whole[axis], least = (high - low) / 5000;
      let size = Math.min(Math.max(b - a, least), high - low), from = (a + b - size) / 2;
      from = Math.min(Math.max(from, low), high - size);
      views[axis] = [from, from + size];
      for (const p of panels) if (p.axis === axis) p.dirty = true;
      redraw();
    };
    const zoom = (axis, factor, at) => {
      const [a, b] = views[axis], about = at ?? (a + b) / 2;
      show(axis, [about - (about - a) * factor, about + (b - about) * factor]);
    };
    const move = share => { const [a, b] = views[own], by = share * (b - a); show(own, [a + by, b + by]); };
    const names = () => {
      for (const one of strip.querySelectorAll(".names span")) {
        one.dataset.at ||= `${parseFloat(one.style.left)} ${parseFloat(one.style.width)}`;
        const [left, width] = one.dataset.at.split(" ").map(Number), [a, b] = views[own], [low, high] = root.full;
        const from = ((low + left / 100 * (high - low)) - a) / (b - a) * 100, to = from + width * (high - low) / (b - a);
        one.style.left = `${Math.max(0, from)}%`;
        one.style.width = `${Math.max(0, Math.min(100, to) - Math.max(0, from))}%`;
      }
    };
    const track = data.plan ? data.plan.map(text => new Float32Array(bytes(text))) : null;
    const path = () => {
      if (!track) return;
      const [a, b] = views[own], all = a <= whole[own][0] && b >= whole[own][1], parts = [];
      for (let k = place(track[0], a - root.full[0]), up = true; !all && k < track[0].length && track[0][k] <= b - root.full[0]; k++) {
        const gone = Number.isNaN(track[1][k]);
        if (!gone) parts.push(`${up ? "M" : "L"}${n(track[1][k])} ${n(track[2][k])}`);
        up = gone;
      }
      plan.querySelector(".zoomed").setAttribute("d", parts.join(""));
    };

    // the read-out, and what is dragged
    const cursors = new Map();
    const cursor = (plot, kind) => {
      const key = kind + figures.indexOf(plot) + (plot === strip ? "s" : "");
      const box = plot.querySelector(".plot");
      if (!cursors.has(key)) cursors.set(key, make("div", box, "", kind));
      return cursors.get(key);
    };
    const spot = (figure, from, to) => {
      const svg = figure.querySelector("svg.area"), box = svg.parentNode.getBoundingClientRect(), r = svg.getBoundingClientRect();
      return [r.left - box.left + from * r.width, (to - from) * r.width];
    };
    const hover = (axis, x) => {
      const [a, b] = views[axis], share = (x - a) / (b - a);
      for (const p of panels) {
        if (p.axis !== axis || !p.shown) continue;
        const line = cursor(p.figure, "cursor");
        line.style.display = "block";
        line.style.left = `${spot(p.figure, share, share)[0]}px`;
        p.read(x);
      }
      if (axis !== own) return;
      if (strip) {
        const now = data.events.filter(([, from, to]) => x >= from - (b - a) / 400 && x <= to + (b - a) / 400);
        strip.querySelector("output").textContent = [...new Set(now.map(e => e[0] === "mode" ? `mode ${e[3]}` : e[3]))].slice(0, 4).join("; ");
      }
      said.textContent = own === "time" ? `${round(x)} s` : `reading ${Math.round(x)}`;
      if (track) {
        const k = Math.min(track[0].length - 1, place(track[0], x - root.full[0])), here = plan.querySelector(".here");
        if (!Number.isNaN(track[1][k])) { here.setAttribute("cx", track[1][k]); here.setAttribute("cy", track[2][k]); here.setAttribute("r", 11); }
      }
    };
    const leave = () => {
      for (const line of cursors.values()) line.style.display = "none";
      for (const p of panels) p.clear();
      if (strip) strip.querySelector("output").textContent = "";
      if (plan) plan.querySelector(".here").setAttribute("r", 0);
      tell();
    };
    const listen = (figure, svg, axis) => {
      let from = null;
      const at = e => { const r = svg.getBoundingClientRect(); return Math.min(1, Math.max(0, (e.clientX - r.left) / r.width)); };
      const value = share => views[axis][0] + share * (views[axis][1] - views[axis][0]);
      svg.addEventListener("pointerdown", e => { if (e.button === 0) { from = at(e); svg.setPointerCapture(e.pointerId); } });
      svg.addEventListener("pointermove", e => {
        hover(axis, value(at(e)));
        if (from === null) return;
        const box = cursor(figure, "chosen"), [left, width] = spot(figure, Math.min(from, at(e)), Math.max(from, at(e)));
        box.style.display = "block"; box.style.left = `${left}px`; box.style.width = `${width}px`;
      });
      const end = (e, take) => {
        if (from === null) return;
        const ends = [from, at(e)].sort((p, q) => p - q), wide = (ends[1] - ends[0]) * svg.getBoundingClientRect().width;
        from = null;
        cursor(figure, "chosen").style.display = "none";
        if (take && wide > 6) show(axis, ends.map(value));
      };
      svg.addEventListener("pointerup", e => end(e, true));
      svg.addEventListener("pointercancel", e => end(e, false));
      svg.addEventListener("pointerleave", () => { if (from === null) leave(); });
      svg.addEventListener("dblclick", () => show(axis, whole[axis]));
      svg.addEventListener("wheel", e => {
        if (!(e.ctrlKey || e.metaKey || e.shiftKey)) return;
        e.preventDefault();
        zoom(axis, Math.exp(0.002 * Math.max(-300, Math.min(300, e.deltaY || e.deltaX))), value(at(e)));
      }, { passive: false });
    };
    for (const p of panels) listen(p.figure, p.svg, p.axis);
    if (strip) for (const svg of strip.querySelectorAll("svg.area")) listen(strip, svg, own);
    tools.addEventListener("keydown", e => {
      const act = { ArrowLeft: "earlier", ArrowRight: "later", "+": "closer", "-": "wider", "0": "all of it" }[e.key];
      if (act) { buttons[act].click(); e.preventDefault(); }
    });
    const seen = new IntersectionObserver(entries => {
      for (const entry of entries) {
        const p = panels.find(one => one.figure === entry.target);
        p.shown = entry.isIntersecting;
        if (p.shown && p.stale) p.draw(views[p.axis]);
      }
    }, { rootMargin: "200px" });
    for (const p of panels) seen.observe(p.figure);
    addEventListener("beforeprint", () => { for (const p of panels) { p.shown = true; if (p.stale) p.draw(views[p.axis]); } });
    tell();
  };
  for (const root of document.querySelectorAll(".review")) begin(root);
})();
