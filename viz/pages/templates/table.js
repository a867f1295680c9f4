// tables that are sorted by a click on a heading, filtered by words, and saved as CSV as they are shown
(() => {
  const made = (name, fields) => Object.assign(document.createElement(name), fields);
  const words = cell => cell.textContent.trim().replace(/\u2212/g, "-");
  const value = cell => { const found = words(cell).match(/^[-+]?\d*\.?\d+(e[-+]?\d+)?/i); return found ? +found[0] : NaN; };
  const quoted = text => /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  document.querySelectorAll(".scroll > table").forEach(table => {
    const body = table.tBodies[0], rows = [...body.rows], heads = [...table.tHead.rows[0].cells];
    if (rows.length < 8) return;
    const tools = made("div", { className: "tools" }), filter = made("input", { type: "search", placeholder: "show rows with …" });
    const count = made("span", { role: "status" }), save = made("button", { type: "button", textContent: "CSV of what is shown" });
    filter.setAttribute("aria-label", "show rows with");
    const shown = () => [...body.rows].filter(row => !row.hidden);
    const told = () => { const few = shown().length; count.textContent = `${few} of ${rows.length} row${rows.length === 1 ? "" : "s"}`; };
    filter.addEventListener("input", () => {
      const wanted = filter.value.toLowerCase().split(/\s+/).filter(Boolean);
      rows.forEach(row => { const text = row.textContent.toLowerCase(); row.hidden = !wanted.every(word => text.includes(word)); });
      told();
    });
    save.addEventListener("click", () => {
      const lines = [heads, ...shown().map(row => [...row.cells])].map(cells => cells.map(cell => quoted(words(cell))).join(","));
      const link = made("a", { href: URL.createObjectURL(new Blob([lines.join("\n") + "\n"], { type: "text/csv" })), download: "shown.csv" });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    });
    heads.forEach((head, column) => {
      const button = made("button", { type: "button", className: "sort", textContent: head.textContent });
      button.addEventListener("click", () => {
        const up = head.getAttribute("aria-sort") !== "ascending", numeric = !head.classList.contains("text");
        heads.forEach(other => other.removeAttribute("aria-sort"));
        head.setAttribute("aria-sort", up ? "ascending" : "descending");
        const keys = new Map(rows.map(row => [row, (numeric ? value : words)(row.cells[column])]));
        const empty = key => key === "" || Number.isNaN(key);
        // rows without the number stay below, whichever way
        body.append(...[...rows].sort((one, other) => {
          const [a, b] = [keys.get(one), keys.get(other)];
          return empty(a) || empty(b) ? empty(a) - empty(b) : (a < b ? -1 : +(a > b)) * (up ? 1 : -1);
        }));
      });
      head.replaceChildren(button);
    });
    tools.append(filter, count, save);
    table.parentElement.before(tools);
    told();
  });
})();
