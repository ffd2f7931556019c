// Reads values off curves: pointing at a panel shows every line's value at the nearest x.
"use strict";
for (const panel of document.querySelectorAll("[data-hover]")) {
  const data = JSON.parse(panel.dataset.hover);
  const [left, top, width, height] = data.box;
  const tip = document.createElement("div");
  const guide = document.createElement("div");
  tip.className = "tip";
  guide.className = "guide";
  const hide = () => { tip.remove(); guide.remove(); };
  const nearest = (xs, x) => xs.reduce((best, v, i) => (Math.abs(v - x) < Math.abs(xs[best] - x) ? i : best), 0);
  const text = (v) => (v === null ? "–" : String(v).replace("-", "\u2212"));

  const show = (event) => {
    const frame = panel.getBoundingClientRect();
    const share = ((event.clientX - frame.left) / frame.width - left) / width;
    if (share < -0.02 || share > 1.02) { hide(); return; }
    const x = data.x[0] + share * (data.x[1] - data.x[0]);
    tip.replaceChildren();
    let at = null;
    for (const line of data.lines) {
      const i = nearest(line.x, x);
      if (line.y[i] === null) continue;
      at = at === null ? line.x[i] : at;
      const row = document.createElement("div");
      const dot = document.createElement("i");
      dot.style.background = line.colour;
      row.append(dot, `${line.name}: ${text(line.y[i])}${line.e[i] === null ? "" : ` ± ${text(line.e[i])}`}`);
      tip.append(row);
    }
    if (at === null) { hide(); return; }
    const head = document.createElement("div");
    head.textContent = `at ${text(at)}`;
    tip.prepend(head);
    const place = (left + ((at - data.x[0]) / (data.x[1] - data.x[0])) * width) * frame.width;
    guide.style.cssText = `left:${place}px;top:${top * frame.height}px;height:${height * frame.height}px`;
    panel.append(guide, tip);
    const flip = place + tip.offsetWidth + 12 > panel.clientWidth;
    tip.style.left = `${Math.max(2, flip ? place - tip.offsetWidth - 8 : place + 8)}px`;
    tip.style.top = `${Math.max(2, Math.min(event.clientY - frame.top, panel.clientHeight - tip.offsetHeight - 2))}px`;
  };
  panel.addEventListener("pointermove", show);
  panel.addEventListener("pointerdown", show);
  panel.addEventListener("pointerleave", hide);
}
