// The question that the wizard asks now, as a form. The wizard judges the answer; here it is only read.
import { $, make } from "/dom.js";

const PLAIN = /^[+-]?(\d+([.,]\d*)?|[.,]\d+)(e[+-]?\d+)?$/i;
const RADIOS = 7;
let current = null;

function head({ words, why }) {
  return [make("span", { class: "words" }, words), ...(why ? [make("small", { id: "because" }, why)] : [])];
}

function field(question) {
  const { kind, unit } = question;
  const number = kind === "number";
  const input = make("input", { id: "field", type: "text", autocomplete: "off", spellcheck: "false", maxlength: number ? 60 : 2000,
    inputmode: number ? "decimal" : "text", "aria-describedby": "because problem" });
  input.value = question.default ?? "";
  const row = make("span", { class: "row field" }, input, ...(unit ? [make("span", { class: "unit" }, unit)] : []));
  return [make("label", { for: "field" }, ...head(question)), row];
}

function radios(question, options) {
  const rows = options.map(([value, words], index) => {
    const input = make("input", { type: "radio", name: "field", value: index });
    input.checked = value === question.default;
    return make("label", { class: "option" }, input, words);
  });
  return [make("fieldset", {}, make("legend", {}, ...head(question)), ...rows)];
}

function menu(question, options) {
  const select = make("select", { id: "field" }, make("option", { value: "" }, "choose …"));
  options.forEach(([value, words], index) => {
    const option = make("option", { value: index }, words);
    option.selected = value === question.default;
    select.append(option);
  });
  return [make("label", { for: "field" }, ...head(question)), select];
}

function optionsOf(question) {
  if (question.kind === "yesno") return [[true, "Yes"], [false, "No"]];
  return question.kind === "choice" ? question.choices.map(choice => [choice, choice]) : null;
}

// what was answered, or why it is none yet
function reading(question) {
  const options = optionsOf(question);
  if (options) {
    const chosen = document.querySelector("#asked input:checked")?.value ?? $("field")?.value ?? "";
    return chosen === "" ? { problem: "Choose one." } : { value: options[+chosen][0], words: options[+chosen][1] };
  }
  const typed = $("field").value.trim();
  if (!typed) return { problem: question.kind === "number" ? "A number is needed." : "An answer is needed." };
  if (question.kind === "text") return { value: typed, words: typed };
  const plain = PLAIN.test(typed);
  const value = plain ? Number(typed.replace(",", ".")) : typed;
  return { value, words: plain && question.unit ? `${value} ${question.unit}` : String(value) };
}

export function showQuestion(question, answer) {
  const form = $("question");
  const again = current && question && current.key === question.key;
  form.hidden = !question;
  $("problem").textContent = question?.problem ?? "";
  if (!again) $("sent").textContent = "";
  if (!question) { current = null; return; }
  const same = again && ["words", "why", "kind", "unit", "default"].every(key => current[key] === question[key])
    && JSON.stringify(current.choices) === JSON.stringify(question.choices);
  current = question;
  if (question.problem) $("sent").textContent = "";
  if (same) { $("field")?.select?.(); return; }
  const options = optionsOf(question);
  const parts = !options ? field(question) : options.length > RADIOS ? menu(question, options) : radios(question, options);
  $("asked").replaceChildren(...parts);
  const first = $("field") ?? document.querySelector("#asked input:checked") ?? document.querySelector("#asked input");
  first?.focus({ preventScroll: true });
  first?.select?.();
  form.onsubmit = async event => {
    event.preventDefault();
    const { problem, value, words } = reading(current);
    $("problem").textContent = problem ?? "";
    if (problem) return;
    const asked = current;
    if (await answer(asked.key, value) && current === asked) $("sent").textContent = `sent: ${words}`;
  };
}
