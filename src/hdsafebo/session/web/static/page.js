"use strict";
// The page shows what /api/status says and sends one step at a time. While a step is on its way every button but
// STOP is dead, and each step names the log's head that was seen, so nothing can be decided twice.
// What is believed and what the limits say is shown by showVerdict alone, together with the inputs it is of.

const byId = (id) => document.getElementById(id);
let seen = null; // last status
let busy = false;
let editing = null; // {mode: "modify" | "manual", point, suggestion} while inputs are edited
let recording = 0; // number of the running trial whose record is being entered, where several run
let shownTrial; // the running trial that the form is for
let lookTimer = 0;
let believedOf = ""; // target and trials that the shown belief is of
const onTheWay = new Set(); // of every request but STOP: a browser keeps few connections, and STOP must get one

const CONTACT_TOPS = [[6, 12, 18, 24, 30, 36, 42, 48], [3, 9, 15, 21, 27, 33, 39, 45]]; // mm on the paddle
const CONTACT_COLUMNS = [3, 9]; // drawn further apart than they are, to be hit easily

// A step is JSON; a file follows after the end of its line.
async function call(path, body, file) {
  const controller = new AbortController();
  onTheWay.add(controller);
  try {
    const answer = await fetch(`/api/${path}`, body === undefined ? { signal: controller.signal } : {
      method: "POST",
      headers: { "Content-Type": "application/json", "X-Session-Page": "1" },
      body: withFile(body, file),
      signal: controller.signal,
    });
    const text = await answer.text();
    let result;
    try { result = JSON.parse(text); } catch { result = { error: text || `the program answered ${answer.status}` }; }
    if (!answer.ok && !result.error) result.error = `the program answered ${answer.status}`;
    return result;
  } finally {
    onTheWay.delete(controller);
  }
}

async function send(step, body, file) {
  if (busy) return;
  setBusy(true);
  say("");
  try {
    const result = await call(step, { who: byId("who").value, head: seen && seen.head.hash, halt: seen && seen.halt, ...body }, file);
    if (result.error) say(result.error);
    else editing = null;
  } catch (error) {
    say(`the program does not answer (${error.message}); nothing is known to be recorded: look at the status`);
  }
  await refresh();
  setBusy(false);
}

async function stop() {
  for (const controller of onTheWay) controller.abort();
  for (const id of ["course", "calibration"]) byId(id).removeAttribute("src");
  say("STOP …");
  try {
    const answer = await fetch("/api/stop", {
      method: "POST",
      headers: { "Content-Type": "application/json", "X-Session-Page": "1" },
      body: JSON.stringify({ who: byId("who").value, reason: byId("reason").value.trim() || "stop button" }),
      keepalive: true,
    });
    const result = await answer.json();
    say(result.error || "");
  } catch (error) {
    say(`the program does not answer (${error.message}): stop at the ${!seen || seen.kind === "stimulation" ? "stimulator" : "machine"}`);
  }
  editing = null;
  await refresh(true);
}

async function refresh(again = false) {
  try {
    const status = await call("status");
    if (status.error) { say(status.error); return; }
    const changed = again || !seen || seen.head.hash !== status.head.hash || seen.stopped !== status.stopped;
    seen = status;
    if (changed) show();
  } catch (error) {
    if (error.name !== "AbortError") say("the program does not answer");
  }
}

function setBusy(value) {
  busy = value;
  for (const button of document.querySelectorAll("button:not(.stop)")) button.disabled = value || button.dataset.ready === "no";
  document.body.dataset.busy = value;
}

function say(text) {
  byId("message").textContent = text;
  byId("message").hidden = !text;
}

function show() {
  byId("name").textContent = seen.name;
  document.title = seen.name;
  byId("disclaimer").textContent = seen.disclaimer;
  byId("head").textContent = `${seen.head.seq} ${seen.head.hash}`;
  byId("stopped").hidden = seen.stopped === null;
  byId("stopped").firstElementChild.textContent = `Stopped: ${seen.stopped}`;
  byId("notices").textContent = seen.notices.join("; ");
  byId("notices").hidden = seen.notices.length === 0;
  fill(byId("target"), seen.targets.map((t) => new Option(t, t, false, t === seen.target)));
  showBest();
  showBelieved();
  showHistory();
  byId("course").src = `/api/course.svg?${seen.head.hash}`;
  byId("calibration").src = `/api/calibration.svg?${seen.head.hash}`;
  showNow();
}

function showNow() {
  const { suggestion, stopped } = seen;
  const full = seen.running.length >= seen.at_once;
  const running = seen.running.find((t) => t.number === recording) || (full || stopped !== null ? seen.running[0] : undefined);
  shownTrial = running;
  const buttons = [];
  let point = null, words = "", belief = null, title = "Ready";
  byId("record").hidden = !running;
  byId("reason-row").hidden = true;
  if (editing && (stopped !== null || full || (suggestion && suggestion.number) !== editing.suggestion)) {
    editing = null;
    say("the session has moved on: what was being edited is not delivered");
  }
  if (editing) {
    title = editing.mode === "modify" ? `Change suggestion ${suggestion.number}` : "Own trial";
    point = editing.point;
    byId("reason-row").hidden = false;
    buttons.push(["Deliver this", "approve", () => send(editing.mode, {
      point: editing.point, reason: byId("reason").value, suggestion: editing.suggestion })]);
    buttons.push(["Back", "plain", () => { editing = null; showNow(); }]);
  } else if (running) {
    title = `Trial ${running.number} (${running.origin}): deliver, then record`;
    point = running.point;
    words = running.text;
    belief = running.belief;
    showEntries();
    buttons.push(["Record", "approve", record]);
    buttons.push(["Not delivered", "refuse", () => withReason("not-delivered", { trial: running.number })]);
  } else if (suggestion) {
    title = `Suggestion ${suggestion.number} for ${suggestion.target}`;
    point = suggestion.point;
    words = suggestion.text;
    belief = suggestion.belief;
    const number = { suggestion: suggestion.number };
    buttons.push(["Approve", "approve", () => send("approve", number)]);
    buttons.push(["Change", "plain", () => edit("modify", suggestion.point)]);
    buttons.push(["Refuse", "refuse", () => withReason("refuse", number)]);
  } else if (!stopped) {
    buttons.push(["Suggest", "approve", () => send("suggest", {})]);
    buttons.push(["Own trial", "plain", () => edit("manual", startPoint())]);
  }
  if (!editing) {
    for (const other of seen.running.filter((t) => t !== running)) {
      buttons.push([`Record trial ${other.number}`, "plain", () => { recording = other.number; showNow(); }]);
    }
    if (running && !full && stopped === null) buttons.push(["Back", "plain", () => { recording = 0; showNow(); }]);
  }
  byId("title").textContent = title;
  showPoint(point, words);
  fill(byId("buttons"), buttons.map(([text, kind, act]) => {
    const button = element("button", text, kind);
    button.dataset.step = text;
    button.disabled = busy;
    button.onclick = act;
    return button;
  }));
  if (editing) look();
  else showVerdict({ belief });
}

// The only place where a belief, exceeded limits and whether inputs may be delivered are shown: always together.
function showVerdict({ belief = null, breaches = [], ready = true }) {
  fill(byId("breaches"), breaches.map((text) => element("li", text)));
  showBelief(belief);
  const deliver = byId("buttons").firstElementChild;
  if (!deliver) return;
  deliver.dataset.ready = ready ? "yes" : "no";
  deliver.disabled = busy || !ready;
}

function withReason(step, body) {
  const row = byId("reason-row");
  const reason = byId("reason").value.trim();
  if (row.hidden || !reason) {
    row.hidden = false;
    byId("reason").focus();
    say("Give a reason, then press again.");
    return;
  }
  send(step, { ...body, reason });
}

function edit(mode, point) {
  recording = 0;
  editing = { mode, point: structuredClone(point), suggestion: seen.suggestion && seen.suggestion.number };
  byId("reason").value = "";
  showNow();
}

function startPoint() {
  if (seen.best) return seen.best.point;
  return seen.kind === "stimulation" ? { polarity: Array(16).fill(0), current_ma: 0 } : { values: seen.inputs.map(() => 0) };
}

// The words are the server's, with as many digits as tell the values apart within what is permitted.
function showPoint(point, words = "") {
  fill(byId("paddle"), []);
  fill(byId("values"), []);
  if (!point) return;
  if (point.polarity) {
    byId("paddle").append(paddle(point.polarity));
    if (editing) byId("values").append(number("current, mA", point.current_ma, (v) => { point.current_ma = v; }));
    else byId("values").append(element("strong", `${point.current_ma} mA`));
  } else if (editing) {
    seen.inputs.forEach((name, i) => byId("values").append(number(name, point.values[i], (v) => { point.values[i] = v; })));
  } else {
    for (const word of words.split(" ")) byId("values").append(element("div", word.replace(/=([^=]*)$/, " = $1")));
  }
}

function number(name, value, set) {
  const label = element("label", name);
  const input = element("input");
  Object.assign(input, { type: "number", step: "any", value });
  input.oninput = () => { set(input.valueAsNumber); look(); };
  label.append(input);
  return label;
}

function paddle(polarity) {
  const svg = svgElement("svg", { viewBox: "0 0 14 53" });
  svg.append(svgElement("rect", { x: 0.2, y: 0.2, width: 13.6, height: 52.6, rx: 1.6, fill: "#eef1f4", stroke: "#9aa4ae", "stroke-width": 0.2 }));
  CONTACT_TOPS.forEach((tops, column) => tops.forEach((top, i) => {
    const contact = column * 8 + i;
    const sign = polarity[contact];
    const x = CONTACT_COLUMNS[column] - 0.6;
    const fill = sign < 0 ? "#0b5fa5" : sign > 0 ? "#b3261e" : "#ffffff";
    const box = svgElement("rect", { x, y: top - 1, width: 3, height: 4.4, rx: 0.6, fill, stroke: "#59636e", "stroke-width": 0.2 });
    box.dataset.contact = contact + 1;
    svg.append(box);
    const mark = svgElement("text", { x: x + 1.5, y: top + 1.9, fill: "#fff" });
    mark.textContent = sign < 0 ? "−" : sign > 0 ? "+" : "";
    svg.append(mark);
    const label = svgElement("text", { x: column ? x + 4.1 : x - 1, y: top + 1.7, class: "number" });
    label.textContent = contact + 1;
    svg.append(label);
    if (editing) {
      box.classList.add("editable");
      box.onclick = () => {
        polarity[contact] = sign === 0 ? -1 : sign < 0 ? 1 : 0;
        showPoint(editing.point);
        look();
      };
    }
  }));
  return svg;
}

// Until the program has looked at exactly these inputs nothing is said about them, and they cannot be delivered.
function look() {
  clearTimeout(lookTimer);
  showVerdict({ ready: false });
  lookTimer = setTimeout(async () => {
    if (!editing) return;
    const asked = JSON.stringify(editing.point);
    let result;
    try {
      result = await call("look", { point: editing.point });
    } catch (error) {
      result = { error: `the limits cannot be looked at (${error.message})` };
    }
    if (!editing || JSON.stringify(editing.point) !== asked) return;
    const breaches = result.error ? [result.error] : result.breaches;
    showVerdict({ belief: result.error ? null : result.belief, breaches, ready: breaches.length === 0 });
  }, 250);
}

function showBelief(belief) {
  fill(byId("belief"), []);
  if (!belief) return;
  const table = element("table");
  const row = (name, value, meter) => {
    const line = table.insertRow();
    line.insertCell().textContent = name;
    line.insertCell().textContent = value;
    if (meter !== undefined) {
      const bar = element("meter");
      Object.assign(bar, { min: 0, max: 1, low: 0.8, high: 0.95, optimum: 1, value: meter });
      line.insertCell().append(bar);
    }
  };
  const { mean, sd } = belief.objective;
  row(`predicted ${seen.target}`, `${mean.toFixed(3)} (${(mean - 2 * sd).toFixed(3)} to ${(mean + 2 * sd).toFixed(3)})`);
  for (const [name, value] of Object.entries(belief.safety)) {
    row(`predicted ${name} (safe: ${seen.safety_limits[name]})`, `${value.mean.toFixed(2)} (${value.low.toFixed(2)} to ${value.high.toFixed(2)})`);
  }
  row("probability to be safe", percent(belief.safe_probability), belief.safe_probability);
  row("promised by the method", percent(seen.promised.alpha));
  if (belief.marked_unsafe) row("NOT BELIEVED SAFE", "nothing is; this is the most probably safe trial");
  byId("belief").append(table, element("small", "in brackets: two standard deviations to either side"));
}

function percent(p) {
  return p > 0.9995 ? "> 99.9 %" : `${(100 * p).toFixed(1)} %`;
}

function showEntries() {
  if (byId("entries").dataset.trial === String(shownTrial.number)) return;
  byId("entries").dataset.trial = shownTrial.number;
  byId("file").value = "";
  byId("remark").value = "";
  byId("reason").value = "";
  byId("file-row").hidden = !seen.takes_recordings;
  fill(byId("entries"), seen.entries.map((name) => {
    const label = element("label", seen.takes_recordings ? `Score of ${name}` : name);
    const input = element("input");
    Object.assign(input, { type: "number", step: "any", name });
    label.append(input);
    return label;
  }));
}

async function record() {
  const values = {};
  for (const input of byId("entries").querySelectorAll("input")) if (input.value !== "") values[input.name] = input.valueAsNumber;
  const file = byId("file").files[0];
  const body = { trial: shownTrial.number, values, recording: null, remark: byId("remark").value };
  let content = null;
  try {
    if (file) content = await present(file);
  } catch (error) {
    byId("file").value = "";
    say(`${file.name} was changed or moved since it was chosen: choose it again, then press Record.`);
    return;
  }
  if (content) body.recording = { name: file.name, bytes: content.size };
  await send("record", body, content);
}

// What the file holds now, in memory. Chromium refuses to read a file that was written to since it was chosen, but
// takes it into a form, once.
async function present(file) {
  try {
    return new Blob([await file.arrayBuffer()]);
  } catch (error) {
    const form = new FormData();
    form.append("file", file);
    return (await new Response(form).formData()).get("file");
  }
}

function withFile(step, file) {
  const json = JSON.stringify(step);
  return file ? new Blob([json, "\n", file]) : json;
}

function showBest() {
  const best = seen.best;
  const first = seen.initial_best === null ? "" : ` (best initial ${seen.initial_best.toFixed(3)})`;
  if (best) showTrial("best", `measured best ${seen.target}`, `${best.outcomes[seen.target].toFixed(3)}`, `${first}: ${best.text}, trial ${best.number}`);
  else byId("best").textContent = "no safe trial yet";
  const c = seen.counts;
  byId("counts").textContent = `${c.initial} initial, ${c.recommended} recommended (${c.unsafe_recommended} unsafe), ` +
    `${c.modified} changed, ${c.manual} own, ${c.refused} refused`;
}

function showTrial(id, name, value, rest) {
  fill(byId(id), [`${name} `, element("strong", value), rest]);
}

async function showBelieved() {
  const wanted = seen.target + JSON.stringify(seen.counts);
  if (wanted === believedOf) return;
  believedOf = wanted;
  byId("believed").textContent = "";
  try {
    const { best, slices, error } = await call("believed", {});
    if (wanted !== believedOf) return;
    showSlices(slices || []);
    if (best) {
      const value = `${best.mean.toFixed(3)} ± ${(2 * best.deviation).toFixed(3)}`;
      showTrial("believed", "believed best", value, ` (two standard deviations): ${best.text}, trial ${best.number}`);
    } else if (error) byId("believed").textContent = `nothing is believed: ${error}`;
  } catch (error) {
    believedOf = "";
  }
}

function showSlices(slices) {
  byId("slices").hidden = slices.length === 0;
  fill(document.querySelector("#slices div"), slices.map(({ name, svg }) => {
    const image = element("img");
    image.alt = `what is believed along ${name}`;
    image.src = `data:image/svg+xml,${encodeURIComponent(svg)}`;
    return image;
  }));
}

function showHistory() {
  const names = ["trial", "chosen by", "inputs", "target", "outcome", "predicted", "safety", "P(safe)", "who"];
  const head = document.querySelector("#history thead");
  fill(head, []);
  const first = head.insertRow();
  for (const name of names) first.append(element("th", name));
  const body = document.querySelector("#history tbody");
  fill(body, []);
  for (const trial of seen.history) {
    const row = body.insertRow();
    if (trial.unsafe) row.className = "unsafe";
    const target = trial.target || seen.target;
    const outcome = trial.outcomes ? trial.outcomes[target].toFixed(3) : trial.status === "running" ? "…" : trial.failure || "none";
    const safety = trial.safety ? Object.values(trial.safety).map((v) => Number(v.toPrecision(4))).join(", ") : "";
    const belief = trial.belief;
    const cells = [trial.number, trial.origin, trial.text, trial.target || "", outcome,
      belief ? `${belief.objective.mean.toFixed(3)}` : "", trial.unsafe ? `${safety} unsafe` : safety,
      belief ? percent(belief.safe_probability) : "", trial.decided_by];
    for (const cell of cells) row.insertCell().textContent = cell;
  }
}

function fill(parent, children) { parent.replaceChildren(...children); }

function element(name, text = "", kind = "") {
  const made = document.createElement(name);
  made.textContent = text;
  if (kind) made.className = kind;
  return made;
}

function svgElement(name, attributes) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

byId("stop").onclick = stop;
byId("resume").onclick = () => send("resume", {});
byId("target").onchange = () => send("target", { target: byId("target").value });
byId("record").onsubmit = (event) => event.preventDefault();
byId("who").value = localStorage.getItem("who") || "";
byId("who").oninput = () => localStorage.setItem("who", byId("who").value);
refresh();
setInterval(() => refresh(), 3000);
