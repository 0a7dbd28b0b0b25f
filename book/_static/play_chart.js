/* One chart of a figure to play with, drawn by uPlot: scales, ticks, colours of the theme, the band of 10 %. */
"use strict";

const himapChart = (() => {
  const BAND = 0.1; // half width of the grey band around a ratio of 1
  const CONTRAST = 3; // least of a curve against the background

  const channels = (colour) => [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
  const hex = (rgb) => "#" + rgb.map((one) => Math.round(one).toString(16).padStart(2, "0")).join("");

  function luminance(rgb) {
    const linear = rgb.map((one) => one / 255).map((one) => (one <= 0.04045 ? one / 12.92 : ((one + 0.055) / 1.055) ** 2.4));
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
  }

  /* The colour, moved towards white (or black) until it stands out of the background. */
  function legible(colour, dark) {
    const [ground, goal] = dark ? [luminance([18, 18, 18]), 255] : [1, 0];
    let rgb = channels(colour);
    const contrast = () => {
      const [low, high] = [luminance(rgb), ground].sort((a, b) => a - b);
      return (high + 0.05) / (low + 0.05);
    };
    for (let step = 0; contrast() < (dark ? CONTRAST : 1.5) && step < 40; step += 1) {
      rgb = rgb.map((one) => one + (goal - one) * 0.1);
    }
    return hex(rgb);
  }

  const text = (value) => {
    if (value === null || value === undefined) return "–";
    const size = Math.abs(value);
    if (size !== 0 && (size < 1e-3 || size >= 1e5)) {
      const [mantissa, power] = value.toExponential(2).split("e");
      const raised = [...String(Number(power))].map((one) => (one === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[one])).join("");
      return `${mantissa}·10${raised}`;
    }
    return String(Number(value.toPrecision(3)));
  };

  /* Ticks of a logarithmic axis: powers of ten where they are many, else 1, 2, 5, else evenly spaced. */
  function logTicks(low, high) {
    const [first, last] = [Math.floor(Math.log10(low)), Math.ceil(Math.log10(high))];
    const decades = Array.from({ length: last - first + 1 }, (_, n) => first + n);
    const within = (steps) =>
      decades.flatMap((power) => steps.map((one) => one * 10 ** power)).filter((one) => one >= low && one <= high);
    if (last - first > 7) return within([1]).filter((_, n) => n % Math.ceil((last - first) / 7) === 0);
    if (high > 300 * low) return within([1]);
    const few = within([1, 2, 5]);
    return few.length > 2 ? few : within([1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9]);
  }

  const power = (value) => {
    const exponent = Math.log10(value);
    return Math.abs(exponent) >= 4 && Number.isInteger(Math.round(exponent * 1e9) / 1e9)
      ? "10" + [...String(Math.round(exponent))].map((one) => (one === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[one])).join("")
      : text(value);
  };

  function axis(label, log, colours, wide) {
    const look = { stroke: colours.ink, grid: { stroke: colours.grid, width: 1 }, ticks: { stroke: colours.grid, width: 1 } };
    const font = "12px system-ui, sans-serif";
    const own = log
      ? {
          splits: (chart, _, low, high) => logTicks(low, high),
          filter: (chart, splits) => splits,
          values: (chart, splits) => splits.map(power),
        }
      : { values: (chart, splits) => splits.map((one) => text(Number(one.toPrecision(12)))) };
    return { label, labelSize: 22, labelGap: 2, size: wide ? 62 : 34, font, labelFont: font, ...look, ...own };
  }

  function band(chart, colours) {
    const { left, top, width, height } = chart.bbox;
    const at = (value) => chart.valToPos(value, "y", true);
    const context = chart.ctx;
    context.save();
    context.beginPath();
    context.rect(left, top, width, height);
    context.clip();
    context.fillStyle = colours.band;
    context.fillRect(left, at(1 + BAND), width, at(1 - BAND) - at(1 + BAND));
    context.fillStyle = colours.ink;
    context.fillRect(left, at(1) - 0.5, width, 1);
    context.restore();
  }

  /* Ends of the values of the curves that are shown, a little wider. */
  function extent(data, shown, log) {
    let [low, high] = [Infinity, -Infinity];
    data.slice(1).forEach((ys, n) => {
      if (!shown[n]) return;
      for (const y of ys) {
        if (y === null || (log && y <= 0)) continue;
        low = Math.min(low, y);
        high = Math.max(high, y);
      }
    });
    if (low > high) return log ? [0.1, 10] : [0, 1];
    if (log) return [low / 1.4, high * 1.4];
    const margin = 0.05 * (high - low) || 0.05;
    return [low - margin, high + margin];
  }

  /* The series of spreads, [low, high, ...members] of each curve, below the curves in their order. */
  function spreads(curves, shown, dark) {
    return curves.flatMap((curve, n) => curve.spread.map((ys, k) => ({
      of: n,
      ys,
      edge: k < 2,
      series: {
        stroke: k < 2 ? "transparent" : legible(curve.color, dark),
        width: k < 2 ? 0 : 0.6,
        alpha: 0.6,
        show: shown[n],
        spanGaps: true,
        points: { show: false },
      },
    })));
  }

  /* about: {place, width, height, x, curves: [{label, color, dash, width, points, ys, spread}], shown,
     labels: [x, y], logs: [x, y], range: [low, high] or null, band, dark, key, moved} */
  function draw(about) {
    const { dark } = about;
    const colours = dark
      ? { ink: "#e0e0e0", grid: "#3a3a3a", band: "#2b2b2b" }
      : { ink: "#222222", grid: "#e4e4e4", band: "#ececec" };
    const positive = (ys) => (about.logs[1] ? ys.map((y) => (y > 0 ? y : null)) : ys);
    const several = spreads(about.curves, about.shown, dark);
    const data = [about.x, ...[...about.curves, ...several].map((one) => positive(one.ys))];
    const first = about.curves.length + 1; // of the series of spreads
    const edges = several.filter((one) => one.edge);
    const seen = [...about.shown, ...several.map((one) => one.edge && about.shown[one.of])];
    const ends = [about.x[0], about.x[about.x.length - 1]];
    const whole = { x: about.logs[0] ? ends : [ends[0] - 0.5, ends[1] + 0.5], y: about.range || extent(data, seen, about.logs[1]) };
    const fixed = (chart, low, high, key) => (low === null || low === high ? whole[key] : [low, high]);
    const scale = (log) => ({ time: false, auto: false, range: fixed, ...(log ? { distr: 3 } : {}) });
    const series = about.curves.map((curve, n) => ({
      label: curve.label,
      stroke: legible(curve.color, dark),
      width: curve.width,
      dash: curve.dash.length ? curve.dash : undefined,
      show: about.shown[n],
      spanGaps: true,
      points: curve.points ? { show: true, size: 11, fill: legible(curve.color, dark) } : { show: false },
      ...(curve.points ? { paths: () => null } : {}),
    }));
    const options = {
      width: about.width,
      height: about.height,
      legend: { show: false },
      focus: { alpha: 0.15 },
      cursor: { sync: { key: about.key, scales: ["x", null] }, drag: { x: true, y: true, uni: 30 }, points: { size: (chart, n) => (n < first ? 7 : 0) } },
      scales: { x: { ...scale(about.logs[0]), min: whole.x[0], max: whole.x[1] }, y: { ...scale(about.logs[1]), min: whole.y[0], max: whole.y[1] } },
      axes: [axis(about.labels[0], about.logs[0], colours, false), axis(about.labels[1], about.logs[1], colours, true)],
      series: [{}, ...series, ...several.map((one) => one.series)],
      bands: edges.flatMap((one, k) => (k % 2 ? [{ series: [one, edges[k - 1]].map((edge) => first + several.indexOf(edge)), fill: `${legible(about.curves[one.of].color, dark)}40` }] : [])),
      hooks: { setCursor: [about.moved], drawClear: about.band ? [(chart) => band(chart, colours)] : [] },
    };
    const chart = new uPlot(options, data, about.place);
    chart.himapWhole = whole;
    chart.himapSeries = about.curves.map((_, n) => [n + 1, ...several.flatMap((one, k) => (one.of === n ? [first + k] : []))]);
    chart.setScale("x", { min: whole.x[0], max: whole.x[1] });
    chart.setScale("y", { min: whole.y[0], max: whole.y[1] });
    chart.over.addEventListener("dblclick", () => reset(chart));
    return chart;
  }

  /* A curve and its spread. */
  const show = (chart, n, shown) => chart.batch(() => chart.himapSeries[n].forEach((at) => chart.setSeries(at, { show: shown })));

  const reset = (chart) => chart.batch(() => ["x", "y"].forEach((key) => {
    chart.setScale(key, { min: chart.himapWhole[key][0], max: chart.himapWhole[key][1] });
  }));

  /* Closer (factor below 1) or further away along x, about the cursor or the middle. */
  function zoom(chart, factor) {
    const { min, max, distr } = chart.scales.x;
    const [to, from] = distr === 3 ? [Math.log, Math.exp] : [(one) => one, (one) => one];
    const at = chart.cursor.idx === null || chart.cursor.idx === undefined ? (to(min) + to(max)) / 2 : to(chart.data[0][chart.cursor.idx]);
    const [first, last] = chart.himapWhole.x;
    const limits = [at - (at - to(min)) * factor, at + (to(max) - at) * factor].map(from);
    chart.setScale("x", { min: Math.max(first, limits[0]), max: Math.min(last, limits[1]) });
  }

  return { draw, legible, reset, show, text, zoom };
})();
