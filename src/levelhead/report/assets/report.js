(() => {
  "use strict";

  const data = JSON.parse(document.getElementById("report-data").textContent);
  const PRINT_WIDTH = 688; // px, just below the 184 mm that the margins of report.css leave of A4
  const HEIGHT = 214; // px, as .canvas in report.css
  const PRINT_HEIGHT = 184;
  const root = document.documentElement;
  const resetButton = document.getElementById("reset");
  const pathCursor = document.getElementById("path-cursor");
  let plots = [];
  let range = [data.start, data.end];

  // The inverse of decimate.encode: a running sum of whole steps, null for a gap.
  function decode(column) {
    const scale = 10 ** column.decimals;
    let sum = 0;
    return column.steps.map((step) => (step === null ? null : (sum += step) / scale));
  }

  const tables = data.plots.map((plot) => [decode(plot.time), ...plot.curves.map((curve) => decode(curve.values))]);
  const path = data.path && { time: decode(data.path.time), x: decode(data.path.x), y: decode(data.path.y) };

  const colour = (name) => getComputedStyle(root).getPropertyValue(name).trim();

  function isWhole(min, max) {
    const slack = 1e-6 * (data.end - data.start);
    return min <= data.start + slack && max >= data.end - slack;
  }

  // Text of a tick or a value: as many digits as the step between ticks needs, never an exponent.
  function digitsOf(step) {
    let digits = 0;
    while (digits < 9 && Math.abs(step * 10 ** digits - Math.round(step * 10 ** digits)) > 1e-6) digits += 1;
    return digits;
  }

  function tickTexts(u, splits, axis, space, step) {
    const digits = digitsOf(step);
    return splits.map((value) => (value === null ? "" : value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1")));
  }

  // A value of the legend: empty without a cursor, a dash in a gap.
  function text(u, value, digits, unit = "") {
    if (u.cursor.idx === null || u.cursor.idx === undefined) return "";
    return value === null || value === undefined ? "–" : value.toFixed(digits) + unit;
  }

  function drawBands(u) {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    for (const [kind, bands] of Object.entries(data.bands)) {
      ctx.fillStyle = colour("--band-" + kind);
      for (const [from, to] of bands) {
        if (to < u.scales.x.min || from > u.scales.x.max) continue;
        const left = u.valToPos(from, "x", true);
        ctx.fillRect(left, bbox.top, Math.max(u.valToPos(to, "x", true) - left, 1), bbox.height);
      }
    }
    ctx.restore();
  }

  // Every plot shows the same stretch of time: the one that was zoomed tells the others.
  function shareRange(u, scale) {
    if (scale !== "x") return;
    const { min, max } = u.scales.x;
    if (min === null || (min === range[0] && max === range[1])) return;
    range = [min, max];
    resetButton.hidden = isWhole(min, max);
    for (const other of plots) if (other !== u) other.setScale("x", { min, max });
  }

  function markPath(u) {
    if (!path || !u.cursor.event) return; // only the plot under the mouse has an event
    const { left, idx } = u.cursor;
    if (left === undefined || left < 0 || idx === null || idx === undefined) return hidePathMark();
    const time = u.posToVal(left, "x");
    let low = 0;
    let high = path.time.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (path.time[middle] <= time) low = middle;
      else high = middle;
    }
    const span = path.time[high] - path.time[low];
    const share = span > 0 ? Math.min(1, Math.max(0, (time - path.time[low]) / span)) : 0;
    pathCursor.setAttribute("cx", path.x[low] + share * (path.x[high] - path.x[low]));
    pathCursor.setAttribute("cy", path.y[low] + share * (path.y[high] - path.y[low]));
  }

  function hidePathMark() {
    if (!pathCursor) return;
    pathCursor.setAttribute("cx", -20);
    pathCursor.setAttribute("cy", -20);
  }

  // uPlot asks for the range of x first and stores both later: `shown` is the x range that this y range goes with.
  function verticalRange(plot, shown) {
    return (u, low, high) => {
      if (plot.cyclic) return plot.view;
      if (plot.view && isWhole(...shown.x)) return plot.view;
      if (low === null || !Number.isFinite(low)) return [0, 1];
      if (low === high) return [low - 1, high + 1];
      return uPlot.rangeNum(low, high, 0.08, false);
    };
  }

  function series(plot, curve) {
    return {
      label: curve.label,
      class: curve.dashed ? "truth" : undefined,
      stroke: curve.dashed ? colour("--ink") : colour("--tone-" + curve.tone),
      width: curve.dashed || curve.faint ? 1 : 1.6,
      alpha: curve.faint ? 0.4 : 1,
      dash: curve.dashed ? [5, 4] : undefined,
      points: { show: false },
      value: (u, value) => text(u, value, Math.min(plot.decimals, 5)),
    };
  }

  function axis(label) {
    return {
      stroke: colour("--soft"),
      font: "11.5px system-ui, sans-serif",
      grid: { stroke: colour("--grid"), width: 1 },
      ticks: { show: false },
      values: tickTexts,
      ...label,
    };
  }

  function build(plot, table, printing) {
    const figure = document.getElementById("plot-" + plot.name);
    const target = figure.querySelector(".canvas");
    const legend = figure.querySelector(".legend");
    target.replaceChildren();
    legend.replaceChildren();
    const vertical = { size: 58, gap: 6, space: 26 };
    const shown = { x: [data.start, data.end] };
    if (plot.cyclic) vertical.splits = () => [0, 90, 180, 270, 360];
    const options = {
      width: printing ? PRINT_WIDTH : target.clientWidth,
      height: printing ? PRINT_HEIGHT : HEIGHT,
      padding: [8, 12, 0, 0],
      legend: {
        mount: (u, element) => legend.append(element),
        markers: { width: 0, fill: (u, k) => u.series[k].stroke(u, k) },
      },
      cursor: {
        y: false,
        drag: { x: true, y: false },
        points: { size: 6 },
        sync: {
          key: "levelhead",
          scales: ["x", null],
          filters: { pub: (type) => type === "mousemove" || type === "mouseleave" },
        },
      },
      scales: {
        x: { time: false, range: (u, low, high) => (shown.x = [low, high]) },
        y: { range: verticalRange(plot, shown) },
      },
      axes: [axis({ size: 26, gap: 5 }), axis(vertical)],
      series: [
        { label: "time", value: (u, value) => text(u, value, 2, " s") },
        ...plot.curves.map((curve) => series(plot, curve)),
      ],
      hooks: { drawClear: [drawBands], setScale: [shareRange], setCursor: [markPath] },
    };
    return new uPlot(options, table, target);
  }

  function buildAll() {
    const printing = root.classList.contains("printing");
    const [min, max] = range;
    plots.forEach((plot) => plot.destroy());
    plots = data.plots.map((plot, k) => build(plot, tables[k], printing));
    if (!isWhole(min, max)) plots.forEach((plot) => plot.setScale("x", { min, max }));
  }

  function setPrinting(on) {
    if (root.classList.toggle("printing", on) === on) buildAll();
  }

  buildAll();
  document.getElementById("hint").hidden = false;
  resetButton.addEventListener("click", () => {
    plots.forEach((plot) => plot.setScale("x", { min: data.start, max: data.end }));
  });
  document.querySelectorAll(".plots").forEach((grid) => grid.addEventListener("mouseleave", hidePathMark));
  window.addEventListener("beforeprint", () => setPrinting(true));
  window.addEventListener("afterprint", () => setPrinting(false));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", buildAll);
  // All grids of plots are equally wide: to watch one of them is enough.
  new ResizeObserver(() => {
    if (root.classList.contains("printing")) return;
    for (const plot of plots) {
      const width = plot.root.parentElement.clientWidth;
      if (width > 0 && width !== plot.width) plot.setSize({ width, height: HEIGHT });
    }
  }).observe(document.querySelector(".plots"));
})();
