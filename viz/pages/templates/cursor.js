(() => {
  const plots = [...document.querySelectorAll("svg.time")], name = "http://www.w3.org/2000/svg";
  const made = plots.map(plot => {
    const box = plot.viewBox.baseVal, line = document.createElementNS(name, "line");
    const text = document.createElementNS(name, "text");
    line.setAttribute("class", "cursor"); text.setAttribute("class", "cursor-time");
    line.setAttribute("y1", 30); line.setAttribute("y2", box.height - 18);
    text.setAttribute("y", 27); plot.append(line, text); return { plot, line, text, width: box.width };
  });
  const hide = () => made.forEach(({ line, text }) => { line.style.display = text.style.display = "none"; });
  const show = event => {
    const at = event.currentTarget.getBoundingClientRect();
    made.forEach(({ plot, line, text, width }) => {
      const x = (event.clientX - at.left) / at.width * width, area = plot.dataset;
      const share = (x - area.left) / (area.right - area.left);
      if (share < 0 || share > 1) return hide();
      line.style.display = text.style.display = "";
      line.setAttribute("x1", x); line.setAttribute("x2", x); text.setAttribute("x", x + 4);
      text.textContent = (+area.first + share * (area.last - area.first)).toFixed(3) + " s";
    });
  };
  hide();
  plots.forEach(plot => { plot.addEventListener("mousemove", show); plot.addEventListener("mouseleave", hide); });
})();
