// Buttons of the legend switch series; the point nearest to the pointer is named behind its chart.
for (const button of document.querySelectorAll(".legend button")) {
  button.addEventListener("click", () => {
    const shown = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", shown);
    for (const group of document.querySelectorAll("svg g[data-series]")) {
      if (group.dataset.series === button.dataset.series) group.style.display = shown ? "" : "none";
    }
  });
}
for (const chart of document.querySelectorAll("figure.curves")) {
  const svg = chart.querySelector("svg"), output = chart.querySelector("output");
  const name = (event) => {
    const box = svg.getBoundingClientRect(), scale = svg.viewBox.baseVal.width / box.width;
    const x = (event.clientX - box.left) * scale, y = (event.clientY - box.top) * scale;
    let nearest = 400, found = null;
    for (const circle of svg.querySelectorAll("circle")) {
      if (circle.parentNode.style.display === "none") continue;
      const distance = (circle.cx.baseVal.value - x) ** 2 + (circle.cy.baseVal.value - y) ** 2;
      if (distance < nearest) [nearest, found] = [distance, circle];
    }
    output.textContent = found ? found.querySelector("title").textContent : "";
  };
  svg.addEventListener("pointermove", name);
  svg.addEventListener("pointerdown", name);
}
