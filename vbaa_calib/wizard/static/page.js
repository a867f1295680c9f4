// The page: asks for what is new, fills it in as text, sends what a person commands. Text comes from files and
// cameras: it only ever becomes textContent.
import { $, make, text } from "/dom.js";
import { showPicture } from "/picture.js";
import { showQuestion } from "/question.js";

const BUTTONS = [...document.querySelectorAll("#buttons button")];
const SIGNS = { done: "✓", now: "●", todo: "○", skipped: "–" };
const STATUS = { done: "done", now: "now", todo: "to do", skipped: "skipped" };
const SURE = {
  redo: ["Do this step again? What it has so far is kept aside.", "Do it again"],
  quit: ["Stop here? All is saved; the same command goes on from here.", "Stop"],
};
const DRAWINGS = {
  board: "The printed sheet, and its two rulers", lens: "Where and how to hold the board",
  plane: "The axes of antenna and board on the bench, and what is positive", noload: "Lamp, background and antenna",
  loads: "A weight on a thread at the antenna", sensor: "A push towards +z, and the sign of its moment",
};
let shown = 0;
let state = null;
const before = new Map();

// fills a part of the page only when what it shows has changed: readers and typing are left in peace
function renew(name, value, fill) {
  const told = JSON.stringify(value ?? null);
  if (before.get(name) === told) return;
  before.set(name, told);
  fill(value);
}

function list(id, lines) {
  $(id).replaceChildren(...lines.map(line => make("li", {}, String(line))));
  const part = $(`${id}-part`);
  if (part) part.hidden = !lines.length;
}

function showSteps(steps) {
  const at = steps.findIndex(step => step.status === "now");
  text($("where"), at < 0 ? "" : `Step ${at + 1} of ${steps.length}: ${steps[at].title}`);
  $("steps").replaceChildren(...steps.map(step => {
    const sign = make("span", { class: "sign", "aria-hidden": "true" }, SIGNS[step.status] ?? "○");
    const note = make("small", {}, step.note || STATUS[step.status] || "");
    const status = make("span", { class: "unseen" }, ` (${STATUS[step.status] ?? ""})`);
    const item = make("li", { "data-status": step.status }, sign, make("span", { class: "name" }, step.title, status), note);
    if (step.status === "now") item.setAttribute("aria-current", "step");
    return item;
  }));
}

const read = value => typeof value === "number" ? String(+value.toPrecision(3)) : value ?? "–";

function showNumbers(numbers) {
  $("numbers").replaceChildren(...numbers.map(number => {
    const met = number.met === true ? "✓ yes" : number.met === false ? "not yet" : "";
    return make("tr", { "data-met": String(number.met ?? "") }, make("th", { scope: "row", class: "text" }, number.label),
      make("td", {}, read(number.value)), make("td", {}, read(number.goal)), make("td", { class: "met" }, met));
  }));
  $("numbers-part").hidden = !numbers.length;
}

function showVerdict({ finished, verdict, report, step }) {
  $("verdict").hidden = !finished;
  $("verdict").dataset.level = verdict?.level ?? "";
  text($("level"), verdict ? { holds: "✓ holds", "look at": "▲ look at", "does not hold": "✕ does not hold" }[verdict.level] ?? verdict.level : "");
  text($("ended"), verdict?.words ?? step?.title ?? "Finished");
  list("findings", verdict?.found ?? []);
  text($("outcome"), verdict ? step?.what : "");
  $("report").hidden = !report;
  text($("path"), report);
}

function showDrawing(name) {
  $("drawing").hidden = !(name in DRAWINGS);
  if (!(name in DRAWINGS)) return;
  $("drawing").href = $("drawing").firstElementChild.src = `/step_${name}.svg`;
  $("drawing").firstElementChild.alt = `${DRAWINGS[name]} (opens alone)`;
}

function allowed(kind) {
  if (state.can) return state.can.includes(kind);
  return state.finished ? kind === "quit" : kind !== "take" || Boolean(state.live);
}

function show(told) {
  state = told.state;
  $("main").hidden = false; // first: what is hidden takes no focus
  const step = state.step ?? {};
  renew("session", state.session, name => text($("session"), name));
  renew("title", [step.title, state.session], () => { document.title = `${step.title ?? "vbaa wizard"} · ${state.session}`; });
  renew("steps", state.steps ?? [], showSteps);
  renew("verdict", { finished: state.finished, verdict: state.verdict, report: state.report, step }, showVerdict);
  $("task").hidden = Boolean(state.finished) && !state.question;
  for (const id of ["title", "what", "why"]) text($(id), step[id]);
  renew("drawing", state.finished ? null : step.name, showDrawing);
  renew("next", step.next, words => text($("next").lastElementChild, words));
  // not twice: below the picture it stands larger
  $("next").hidden = !step.next || (state.live?.suggestion ?? "").startsWith(step.next);
  $("enough").hidden = !step.enough || Boolean(state.finished);
  renew("question", state.question, question => showQuestion(question, answer));
  renew("usual", state.usual ?? [], lines => list("usual", lines));
  renew("numbers", step.numbers ?? [], showNumbers);
  renew("missing", step.missing ?? [], lines => list("missing", lines));
  renew("seen", step.seen ?? [], lines => list("seen", lines));
  $("standing").hidden = ["numbers", "missing", "seen"].every(id => $(`${id}-part`).hidden);
  renew("log", state.log ?? [], lines => { list("log", lines.slice(-60).reverse()); $("history").hidden = !lines.length; });
  for (const button of BUTTONS) button.hidden = !allowed(button.dataset.kind);
  document.body.classList.toggle("watching", Boolean(state.live));
  document.body.classList.toggle("asking", Boolean(state.question));
  document.body.classList.toggle("finished", Boolean(state.finished));
  const first = step.enough ? "enough" : "take";
  for (const button of BUTTONS) button.classList.toggle("first", button.dataset.kind === first);
}

async function send(kind, value = null) {
  try {
    const body = JSON.stringify({ kind, value, seen: shown });
    const sent = await fetch("/command", { method: "POST", headers: { "Content-Type": "application/json" }, body });
    if (!sent.ok) link(`not accepted: ${(await sent.text()).trim()}`, "bad");
    return sent.ok;
  } catch {
    link("The wizard did not get it: it no longer answers.", "lost");
    return false;
  }
}

const answer = (key, value) => send("answer", { [key]: value });

$("change").addEventListener("submit", async event => {
  event.preventDefault();
  const words = $("changed").value.trim();
  if (words && await send("answer", { change: words })) $("changed").value = "";
});

async function command(kind) {
  if (state && allowed(kind) && (!SURE[kind] || state.finished || await sure(...SURE[kind]))) await send(kind);
}

function sure(words, yes) {
  text($("sure-words"), words);
  text($("yes"), yes);
  $("sure").showModal();
  return new Promise(resolve => { // not by "close": that event comes late, and could answer the next asking
    $("yes").onclick = () => { resolve(true); $("sure").close(); };
    $("no").onclick = () => { resolve(false); $("sure").close(); };
    $("sure").oncancel = () => resolve(false);
  });
}

$("cells").addEventListener("click", event => { if (event.detail) $("cells").blur(); });
for (const button of BUTTONS) {
  button.addEventListener("click", event => {
    if (event.detail) button.blur(); // clicked, not typed: the next Space takes a picture, and presses nothing again
    command(button.dataset.kind);
  });
}
document.addEventListener("keydown", event => {
  const busy = event.target.closest?.("input, select, textarea, button, a, summary, dialog[open]") || $("sure").open;
  if (event.key !== " " || event.repeat || event.ctrlKey || event.altKey || event.metaKey || busy) return;
  event.preventDefault();
  command("take");
});

function link(words, mood) {
  text($("link"), words);
  $("link").dataset.mood = mood;
  document.body.classList.toggle("lost", mood === "lost");
}

const pause = seconds => new Promise(resolve => setTimeout(resolve, 1000 * seconds));
const visible = () => new Promise(resolve => {
  if (!document.hidden) return resolve();
  document.addEventListener("visibilitychange", resolve, { once: true });
});

async function receive(told) {
  shown = told.n;
  try {
    show(told);
    await showPicture(told.picture, told.state.live);
  } catch (error) {
    console.error(error);
    link("This page cannot show what the wizard told: go on in the terminal.", "bad");
  }
}

async function follow() {
  for (;;) {
    await visible(); // a browser has few connections to one address: pages in the background leave them to others
    try {
      const reply = await fetch(`/state?after=${shown}`);
      if (reply.status === 403) return link("This page is of an earlier run: open the address that the terminal shows.", "lost");
      if (!reply.ok) throw new Error(reply.statusText);
      link(state || reply.status === 200 ? "connected" : "connected; the wizard is starting …", "good");
      if (reply.status === 204) { await pause(0.05); continue; }
      await receive(await reply.json());
    } catch {
      link(state?.finished ? "The wizard has ended." : "The wizard does not answer: look at the terminal. Trying again …", "lost");
      await pause(1.5);
    }
  }
}

follow();
