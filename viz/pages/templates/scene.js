// Time, colours and layers of the scene that the offline viewer has drawn: it hands out its render window (vtk.js).
(() => {
  "use strict";
  const story = JSON.parse(document.getElementById("story").textContent);
  const element = (id) => document.getElementById(id);
  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const view = { moment: story.main, mode: story.mode, everything: true, hidden: new Set() };
  let renderer, renderWindow, parts;

  function ready(tries) {
    renderWindow = window.global && window.global.renderWindow;
    renderer = renderWindow && renderWindow.getRenderers().find((each) => each.getActors().length >= story.parts.length);
    if (renderer) start();
    else if (tries > 0) setTimeout(() => ready(tries - 1), 50);
    else element("silent").hidden = false;
  }

  function start() {
    const actors = new Map(renderer.getActors().map((actor) => [actor.get("managedInstanceId").managedInstanceId, actor]));
    parts = story.parts.map((part) => {
      const mesh = actors.get(part.id).getMapper().getInputData();
      return { ...part, actor: actors.get(part.id), ink: actors.get(part.id).getProperty().getColor(), mesh, cells: mesh.getPolys().getData() };
    });
    story.modes.forEach((mode) => { mode.rgb = bytes(mode.rgb); });
    readAddress();
    connect();
    const dark = matchMedia("(prefers-color-scheme: dark)");
    dark.addEventListener("change", () => { shade(dark.matches); renderWindow.render(); });
    shade(dark.matches);
    element("legend").open = innerWidth > 800;
    paint();
    show();
  }

  // the background as the page has it, and what is nearly black light on a dark one
  function shade(dark) {
    renderer.setBackground(dark ? [0.06, 0.09, 0.16] : [1, 1, 1]);
    for (const { name, actor, ink } of parts.filter((part) => ["antenna", "now"].includes(part.name))) {
      actor.getProperty().setColor(dark ? [0.9, 0.93, 0.97] : ink);
    }
  }

  // #moment=30&colour=time&all=0&view=1 opens the page there
  function readAddress() {
    const asked = new URLSearchParams(location.hash.slice(1));
    const moment = Number(asked.get("moment") ?? story.main);
    if (Number.isInteger(moment) && moment >= 0 && moment < story.times.length) view.moment = moment;
    if (story.modes.some((mode) => mode.name === asked.get("colour"))) view.mode = asked.get("colour");
    view.everything = asked.get("all") !== "0";
    look(story.views[Number(asked.get("view") ?? -1)] ?? story.views.at(-1));
  }

  function connect() {
    const slider = element("slider");
    slider.value = view.moment;
    slider.addEventListener("input", () => { view.moment = Number(slider.value); show(); });
    element("everything").checked = view.everything;
    element("everything").addEventListener("change", (event) => { view.everything = event.target.checked; show(); });
    element("mode").value = view.mode;
    element("mode").addEventListener("change", (event) => { view.mode = event.target.value; paint(); renderWindow.render(); });
    document.querySelectorAll("#legend [data-layer]").forEach((box) => box.addEventListener("change", () => {
      if (box.checked) view.hidden.delete(box.dataset.layer); else view.hidden.add(box.dataset.layer);
      show();
    }));
    element("views").querySelectorAll("button").forEach((button, index) => button.addEventListener("click", () => {
      look(story.views[index]);
      renderWindow.render();
    }));
    addEventListener("beforeprint", () => { element("legend").open = true; });
    element("play").addEventListener("click", play);
    element("save").addEventListener("click", () => Promise.all(renderWindow.captureImages()).then(([url]) => {
      Object.assign(document.createElement("a"), { href: url, download: "scene.png" }).click();
    }));
    connectPicking();
  }

  // A contact is picked by a click near it, or by keys: its numbers, its moment and its picture are shown.
  const chosen = { contact: null, from: null };
  const near = 18;

  function connectPicking() {
    let pressed = null;
    document.addEventListener("pointerdown", (event) => { pressed = event.target.closest(".content") && [event.clientX, event.clientY]; }, true);
    document.addEventListener("pointerup", (event) => {
      if (pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 4) pick(nearest(event.clientX, event.clientY));
      pressed = null;
    }, true);
    document.addEventListener("keydown", (event) => {
      const keys = { ArrowRight: () => step(1), ArrowLeft: () => step(-1), m: measure, Escape: () => pick(null) };
      if (event.target.matches("input, select") || event.ctrlKey || event.metaKey || event.altKey || !(event.key in keys)) return;
      keys[event.key]();
      event.preventDefault();
    });
    element("before").addEventListener("click", () => step(-1));
    element("after").addEventListener("click", () => step(1));
    element("measure").addEventListener("click", measure);
    element("none").addEventListener("click", () => pick(null));
    const asked = Number(new URLSearchParams(location.hash.slice(1)).get("contact") ?? NaN);
    if (asked in story.contacts.points) pick(asked);
    const follow = () => { mark(); measures(); requestAnimationFrame(follow); };
    follow();
  }

  // Where the drawing shows a place in the camera's frame: after a resize it is stretched until it is drawn anew.
  function onScreen(seen) {
    const canvas = document.querySelector(".content canvas");
    const { left, top, width, height } = canvas.getBoundingClientRect();
    const [x, y] = renderer.projectionToNormalizedDisplay(...renderer.viewToProjection(...seen, canvas.width / canvas.height));
    return [left + x * width, top + (1 - y) * height];
  }

  // The contact whose ball is drawn under the click; beside all balls, the one nearest to the click.
  function nearest(x, y) {
    const { points, moments, radius } = story.contacts;
    let [found, least] = [null, [1, near]];
    points.forEach((point, index) => {
      if (!view.everything && moments[index] > view.moment) return;
      const seen = renderer.worldToView(...point);
      const [u, v] = onScreen(seen);
      const away = Math.hypot(u - x, v - y);
      const part = away / (onScreen([seen[0] + radius, seen[1], seen[2]])[0] - u);
      const rank = part < 1 ? [0, -seen[2] - radius * Math.sqrt(1 - part * part)] : [1, away];
      if (rank[0] < least[0] || (rank[0] === least[0] && rank[1] < least[1])) [found, least] = [index, rank];
    });
    return found;
  }

  function step(by) {
    const count = story.contacts.points.length;
    pick(chosen.contact === null ? (by > 0 ? 0 : count - 1) : (chosen.contact + by + count) % count);
  }

  function pick(contact) {
    chosen.contact = contact;
    if (contact === null) chosen.from = null;
    else view.moment = story.contacts.moments[contact];
    show();
    tell();
  }

  function measure() {
    chosen.from = chosen.from === null ? chosen.contact : null;
    tell();
  }

  function tell() {
    element("picked").hidden = chosen.contact === null;
    element("measure").textContent = chosen.from === null ? "measure from here" : "end measuring";
    if (chosen.contact === null) return;
    const lines = [story.contacts.words[chosen.contact]];
    if (chosen.from !== null) {
      const [a, b] = [chosen.from, chosen.contact].map((index) => story.contacts.points[index]);
      const between = b.map((value, axis) => value - a[axis]);
      const length = Math.hypot(...between);
      const spread = [chosen.from, chosen.contact].map((index) => story.contacts.covariances[index]);
      const along = between.map((value) => value / (length || 1));
      const variance = spread.every(Boolean) && length > 0 ? spread.reduce((sum, covariance) =>
        sum + covariance.reduce((part, value, i) => part + value * along[Math.floor(i / 3)] * along[i % 3], 0), 0) : NaN;
      const std = Number.isFinite(variance) ? ` ± ${(1e3 * Math.sqrt(Math.max(variance, 0))).toPrecision(2)}` : "";
      lines.push(`${(1e3 * length).toFixed(2)}${std} mm from the contact of ${story.contacts.words[chosen.from].split(",")[0]}`);
    }
    element("numbers").textContent = lines.join("\n");
  }

  function mark() {
    const [line, here, from] = element("marks").children;
    const place = (circle, index) => {
      circle.toggleAttribute("hidden", index === null);
      if (index === null) return null;
      const [x, y] = onScreen(renderer.worldToView(...story.contacts.points[index]));
      circle.setAttribute("cx", x);
      circle.setAttribute("cy", y);
      return [x, y];
    };
    const [to, start] = [place(here, chosen.contact), place(from, chosen.from)];
    line.toggleAttribute("hidden", !(to && start));
    if (to && start) ["x1", "y1", "x2", "y2"].forEach((name, index) => line.setAttribute(name, [...start, ...to][index]));
  }

  // The world's axes as they lie on the screen, and a length that is true where the view is centred.
  function measures() {
    const focus = renderer.getActiveCamera().getFocalPoint();
    const seen = renderer.worldToView(...focus);
    [...element("axes").children].forEach((axis, index) => {
      const tip = renderer.worldToView(...focus.map((value, at) => value + (at === index ? 1e-3 : 0)));
      const [x, y] = [25e3 * (tip[0] - seen[0]), -25e3 * (tip[1] - seen[1])];
      const [line, letter] = axis.children;
      line.setAttribute("x2", x);
      line.setAttribute("y2", y);
      letter.setAttribute("x", 1.45 * x);
      letter.setAttribute("y", 1.45 * y);
    });
    const perMm = Math.abs(onScreen([seen[0] + 1e-3, seen[1], seen[2]])[0] - onScreen(seen)[0]);
    const most = 160 / perMm;
    const step = 10 ** Math.floor(Math.log10(most));
    const length = [5, 2, 1].map((each) => each * step).find((each) => each <= most);
    if (!Number.isFinite(length)) return;
    element("length").style.width = `${length * perMm}px`;
    element("length").textContent = `${Number(length.toPrecision(1))} mm`;
  }

  let timer = null;
  function play() {
    if (timer !== null) {
      clearInterval(timer);
      timer = null;
    } else {
      if (view.moment >= story.times.length - 1) view.moment = -1;
      view.everything = element("everything").checked = false;
      timer = setInterval(() => {
        if (view.moment >= story.times.length - 1) return play();
        view.moment += 1;
        show();
      }, Math.max(40, Math.min(200, 12000 / story.times.length)));
    }
    element("play").textContent = timer === null ? "play" : "pause";
  }

  // from further away where the page is narrow, so that nothing is cut off at its sides
  function look({ position, focus }) {
    const camera = renderer.getActiveCamera();
    const away = Math.max(1, 1.2 * innerHeight / innerWidth);
    camera.setFocalPoint(...focus);
    camera.setPosition(...position.map((value, axis) => focus[axis] + away * (value - focus[axis])));
    camera.setViewUp(0, 0, 1);
    renderer.resetCameraClippingRange();
  }

  function paint() {
    const mode = story.modes.find((each) => each.name === view.mode);
    for (const { mesh, contacts } of parts) {
      if (!contacts) continue;
      const colour = mesh.getPointData().getArrayByName("colour");
      const values = colour.getData();
      const each = values.length / contacts.length;
      contacts.forEach((contact, index) => {
        for (let i = index * each; i < (index + 1) * each; i += 1) values[i] = mode.rgb[3 * contact + (i % 3)];
      });
      colour.modified();
      mesh.modified();
    }
    element("ends").replaceChildren(...mode.ends.map((words) => {
      const span = document.createElement("span");
      span.textContent = words;
      return span;
    }));
    document.querySelectorAll("#colours, i.chosen").forEach((each) => { each.style.background = mode.gradient; });
  }

  function show() {
    const moment = view.moment;
    for (const { name, actor, mesh, cells, span, history, poses, textured } of parts) {
      let visible = !view.hidden.has(name);
      if (span) {
        // four numbers for a triangle: how many corners, and which
        const [first, last] = history && view.everything ? [0, cells.length / 4] : span[moment];
        mesh.getPolys().setData(cells.subarray(4 * first, 4 * last));
        mesh.getPolys().modified();
        mesh.modified();
        visible = visible && last > first;
      }
      if (poses) {
        visible = visible && poses[moment] !== null;
        if (poses[moment]) actor.setUserMatrix(poses[moment]);
      }
      if (textured) {
        visible = visible && story.pictures[moment] !== null;
        if (story.pictures[moment] !== null) hang(actor, story.seen[story.pictures[moment]]);
      }
      actor.setVisibility(visible);
    }
    element("slider").value = moment;
    element("clock").textContent = `${story.times[moment].toFixed(2)} s, frame ${story.frames[moment]}`;
    element("words").textContent = story.words[moment];
    if (story.seen.length) {
      element("seen").hidden = story.pictures[moment] === null;
      if (story.pictures[moment] !== null) element("seen").querySelector("img").src = story.seen[story.pictures[moment]];
      const line = story.lines[moment] ?? [];
      element("seen").querySelector("polyline").setAttribute("points", line.slice(0, -1).map((place) => place.join(",")).join(" "));
      element("seen").querySelector("path").setAttribute("d", line.length ? `M${line.at(-1).join(" ")}h0` : "");
    }
    renderer.resetCameraClippingRange();
    renderWindow.render();
  }

  // The picture as the texture's own bytes, its lowest row first.
  function hang(actor, source) {
    const picture = new Image();
    picture.onload = () => {
      const canvas = document.createElement("canvas");
      [canvas.width, canvas.height] = [picture.width, picture.height];
      const pencil = canvas.getContext("2d", { willReadFrequently: true });
      pencil.drawImage(picture, 0, 0);
      const { data, width, height } = pencil.getImageData(0, 0, canvas.width, canvas.height);
      const texture = actor.getTextures()[0];
      const input = texture.getInputData();
      const scalars = input.getPointData().getScalars();
      const values = scalars.getData();
      for (let row = 0; row < height; row += 1) {
        for (let column = 0; column < width; column += 1) {
          for (let part = 0; part < 3; part += 1) {
            values[3 * ((height - 1 - row) * width + column) + part] = data[4 * (row * width + column) + part];
          }
        }
      }
      scalars.modified();
      input.modified();
      texture.modified();
      renderWindow.render();
    };
    picture.src = source;
  }

  ready(400);
})();
