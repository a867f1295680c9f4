// The camera's picture and what is drawn over it, in the picture's own pixels.
import { $, make, text } from "/dom.js";

let fetched = null;

function draw(name, attributes) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  return node;
}

const twice = (name, attributes, kind) => ["halo", "line"].map(part => draw(name, { ...attributes, class: `${kind} ${part}` }));

function cells({ columns, rows, counts }, [width, height]) {
  const most = Math.max(1, ...counts.flat());
  return counts.flatMap((row, i) => row.map((count, j) => draw("rect", {
    x: j / columns * width - 0.5, y: i / rows * height - 0.5, width: width / columns, height: height / rows,
    class: count ? "cell" : "cell empty", "fill-opacity": count ? (0.07 + 0.2 * count / most).toFixed(3) : 0,
  })));
}

function outline(points) {
  const shape = points.map(point => point.join(",")).join(" ");
  const [[u0, v0], [u1, v1]] = points;
  return [...twice("polygon", { points: shape }, "wanted"), ...twice("path", { d: `M${u0} ${v0}L${u1} ${v1}` }, "upper")];
}

// the word "top" outside the board's top edge, or inside where the picture ends there; never out of the picture
function label(points, [width, height]) {
  const [[u0, v0], [u1, v1]] = points, size = Math.max(width / 32, 15 * width / $("frame").clientWidth);
  const edge = [(u0 + u1) / 2, (v0 + v1) / 2];
  const centre = points.reduce(([u, v], [a, b]) => [u + a / 4, v + b / 4], [0, 0]);
  const away = Math.hypot(centre[0] - edge[0], centre[1] - edge[1]) || 1;
  const beside = side => edge.map((value, i) => value + side * size * (centre[i] - edge[i]) / away);
  const room = ([u, v]) => u > 1.2 * size && u < width - 1.2 * size && v > 0.7 * size && v < height - 0.7 * size;
  const within = (value, most) => Math.min(Math.max(value, 1.2 * size), most - 1.2 * size);
  const [u, v] = [-1, 1].map(beside).find(room) ?? beside(1);
  const words = draw("text", { x: within(u, width), y: within(v, height), "font-size": size, class: "top" });
  words.textContent = "top";
  return words;
}

function marks(live) {
  const [width, height] = live.image_size;
  const drawn = [];
  if (live.coverage && $("cells").checked) drawn.push(...cells(live.coverage, [width, height]));
  if (live.suggested_px) drawn.push(...outline(live.suggested_px));
  // strokes without length, with round ends: dots of the same size on every screen
  const corners = (live.corners_px ?? []).map(([u, v]) => `M${u} ${v}h0`).join("");
  if (corners) drawn.push(...twice("path", { d: corners }, "corner"));
  if (live.suggested_px) drawn.push(label(live.suggested_px, live.image_size));
  $("marks").setAttribute("viewBox", `-0.5 -0.5 ${width} ${height}`);
  $("marks").replaceChildren(...drawn);
}

function hint({ words, remedy, grave }) {
  const sign = make("b", {}, grave ? "✕ wrong" : "▲ look");
  return make("li", { "data-grave": String(Boolean(grave)) }, sign, ` ${words}`, make("span", {}, remedy ? ` → ${remedy}` : ""));
}

let last = null;

// words change at most so often, in seconds: who reads or listens is not hurried by every frame
const CALM = 0.6;
const calm = new Map();

function calmly(name, value, fill) {
  const kept = calm.get(name) ?? { shown: null, since: -Infinity, timer: 0 };
  calm.set(name, kept);
  kept.value = value;
  if (kept.shown === JSON.stringify(value)) { clearTimeout(kept.timer); kept.timer = 0; return; }
  const renew = () => {
    Object.assign(kept, { shown: JSON.stringify(kept.value), since: performance.now(), timer: 0 });
    fill(kept.value);
  };
  kept.timer ||= setTimeout(renew, Math.max(0, 1000 * CALM - (performance.now() - kept.since)));
}

function beside(live) {
  const percent = Math.round(100 * Math.min(1, Math.max(0, live.hold ?? 0)));
  $("hold").hidden = !(percent > 0);
  $("hold").setAttribute("aria-valuenow", percent);
  $("ring").style.strokeDasharray = `${percent} 100`;
  text($("held"), percent >= 100 ? "✓ still" : "hold still");
  calmly("suggestion", live.suggestion ?? "", words => text($("suggestion"), words));
  calmly("hints", live.hints ?? [], hints => $("hints").replaceChildren(...hints.map(hint)));
  $("match").hidden = live.closeness === null || live.closeness === undefined || !live.suggested_px;
  $("closeness").value = Math.round(100 * (live.closeness ?? 0));
  text($("close"), `${$("closeness").value} %`);
  const count = live.corners_px?.length ?? 0;
  text($("found"), live.found || (count ? `● ${count} corners found` : "○ no board in the picture"));
  $("cells").parentElement.hidden = !live.coverage;
  const counts = live.coverage?.counts.flat() ?? [];
  text($("covered"), `show what is covered: ${counts.filter(Boolean).length} of ${counts.length} fields`);
}

// the picture first, then what belongs to it; a picture that cannot be had leaves the one before
export async function showPicture(number, live) {
  $("live").hidden = !live;
  last = live;
  if (!live) return;
  const [width, height] = live.image_size;
  $("frame").style.setProperty("--ratio", width / height);
  if (number !== null && number !== fetched) {
    const next = new Image();
    next.src = `/picture?n=${number}`;
    try {
      await next.decode();
      next.id = "picture";
      next.alt = $("picture").alt;
      $("picture").replaceWith(next);
      fetched = number;
    } catch { /* gone: a newer one is coming */ }
  }
  $("picture").hidden = number === null || fetched === null;
  marks(live);
  beside(live);
}

$("cells").addEventListener("change", () => { if (last) marks(last); });
