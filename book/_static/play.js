/* Figures to play with: the button below a figure puts its curves in the place of the picture, and back. */
"use strict";

const himapPlay = (() => {
  const base = new URL(".", document.currentScript.src);
  const waiting = {};
  const RATIOS = [["0.8 to 1.2", [0.8, 1.2]], ["0.5 to 1.5", [0.5, 1.5]], ["0 to 2", [0, 2]], ["all", null]];
  const [PLAY, BACK] = ["Play with this figure", "Back to the picture"];

  function element(tag, attributes = {}, ...children) {
    const made = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
      else made.setAttribute(name, value);
    }
    made.append(...children);
    return made;
  }

  function select(name, options, chosen, changed) {
    const box = element("select", { onchange: () => changed(box.selectedIndex) });
    options.forEach((text, n) => box.append(new Option(text, n, n === chosen, n === chosen)));
    return element("label", {}, `${name} `, box);
  }

  const dark = () => document.documentElement.dataset.theme === "dark";

  class Player {
    constructor(name, content) {
      this.content = content;
      this.view = 0;
      this.panel = Math.max(0, content.views[0].panels.findIndex((panel) => this.ratioLabel(panel)));
      this.ratio = 1;
      this.hidden = new Set(content.hidden || []);
      this.charts = [];
      this.key = `himap-${name}`;
      this.controls = element("div", { class: "himap-controls" });
      this.legend = element("div", { class: "himap-legend", role: "group", "aria-label": "Curves: press to show or hide" });
      this.places = element("div", { class: "himap-charts", tabindex: 0, role: "application", onkeydown: (event) => this.press(event) });
      this.status = element("p", { class: "himap-status", role: "status" });
      this.note = element("p", { class: "himap-note" });
      this.box = element("div", { class: "himap-player" }, this.controls, this.legend, this.places, this.status, this.note);
    }

    get shown() {
      const view = this.content.views[this.view];
      return view.panels[Math.min(this.panel, view.panels.length - 1)];
    }

    /* That of a panel in which a curve has a ratio; of others empty. */
    ratioLabel(panel) {
      return panel.curves.some((curve) => curve.ratio) ? panel.ratio_label : "";
    }

    /* Everything anew, for what is chosen. */
    draw() {
      this.clear();
      this.drawControls();
      this.drawLegend();
      const { shown } = this;
      const wide = this.box.clientWidth || 700;
      const common = { place: this.places, width: wide, x: shown.x, key: this.key, dark: dark(), moved: (chart) => this.moved(chart) };
      const visible = shown.curves.map((curve) => !this.hidden.has(curve.label));
      const curves = shown.curves.map((curve) => ({ ...curve, ys: curve.y }));
      const logs = [Boolean(shown.x_log), Boolean(shown.y_log)];
      const labels = [shown.x_label, shown.y_label];
      this.charts.push(himapChart.draw({ ...common, height: 300, curves, shown: visible, labels, logs, range: shown.y_range, band: shown.band }));
      const ratio = this.ratioLabel(shown);
      if (ratio) {
        const ratios = shown.curves.map((curve) => ({ ...curve, ys: curve.ratio || shown.x.map(() => null), spread: curve.ratio_spread || [] }));
        this.charts.push(himapChart.draw({ ...common, height: 260, curves: ratios, shown: visible, labels: [labels[0], ratio], logs: [logs[0], false], range: RATIOS[this.ratio][1], band: true }));
      }
      this.places.setAttribute("aria-label", `${shown.title || "Curves"}, ${this.content.views[this.view].label}. Left and right arrows move along the curves, plus and minus zoom, 0 shows all.`);
      this.explain();
      this.slide();
    }

    clear() {
      this.charts.forEach((chart) => chart.destroy());
      this.charts = [];
      this.controls.replaceChildren();
      this.legend.replaceChildren();
      this.status.textContent = "";
    }

    drawControls() {
      const { views, names } = this.content;
      const change = (field) => (index) => {
        this[field] = index;
        const at = [...this.controls.querySelectorAll("select")].indexOf(document.activeElement);
        this.draw();
        this.controls.querySelectorAll("select")[at]?.focus();
      };
      if (views.length > 1) this.controls.append(select(names.view, views.map((one) => one.label), this.view, change("view")));
      const { panels } = views[this.view];
      if (panels.length > 1) this.controls.append(select(names.panel, panels.map((one) => one.title), this.panel, change("panel")));
      if (this.ratioLabel(this.shown)) this.controls.append(select("Ratio from", RATIOS.map((one) => one[0]), this.ratio, change("ratio")));
      if (this.content.slider) this.controls.append(this.slider());
      const button = (text, label, done) => element("button", { type: "button", "aria-label": label, onclick: () => this.charts.forEach(done) }, text);
      this.controls.append(
        element("span", { class: "himap-zoom" },
          button("+", "Zoom in", (chart) => himapChart.zoom(chart, 0.6)),
          button("−", "Zoom out", (chart) => himapChart.zoom(chart, 1 / 0.6)),
          button("Whole range", "Whole range", himapChart.reset)),
      );
    }

    /* The numbers of sources: of the curves, or along the axis; 0 of the former is all. */
    slider() {
      const byCurve = this.content.slider === "curve";
      const steps = byCurve
        ? ["all", ...this.shown.curves.filter((one) => one.label.includes("=")).map((one) => one.label.split("= ")[1])]
        : this.shown.x;
      this.steps = steps;
      this.step = Math.min(this.step || 0, steps.length - 1);
      const said = element("output", {}, String(steps[this.step]));
      const range = element("input", { type: "range", min: 0, max: steps.length - 1, step: 1, value: this.step, "aria-valuetext": String(steps[this.step]) });
      range.addEventListener("input", () => {
        this.step = Number(range.value);
        said.textContent = steps[this.step];
        range.setAttribute("aria-valuetext", String(steps[this.step]));
        this.slide();
      });
      return element("label", {}, "nₛ ", range, " ", said);
    }

    slide() {
      if (this.content.slider === "x") return this.point(this.step || 0, Boolean(this.step));
      if (this.content.slider !== "curve") return;
      const at = this.shown.curves.findIndex((one) => one.label.endsWith(`= ${this.steps[this.step]}`));
      this.charts.forEach((chart) => chart.setSeries(at < 0 ? null : at + 1, { focus: at >= 0 }));
      [...this.legend.children].forEach((one, n) => one.classList.toggle("himap-faint", at >= 0 && n !== at));
    }

    drawLegend() {
      this.shown.curves.forEach((curve) => {
        const colour = himapChart.legible(curve.color, dark());
        const dots = curve.points ? `<circle cx="14" cy="6" r="4" fill="${colour}"/>` : `<path d="M1 6h26" stroke="${colour}" stroke-width="${Math.max(curve.width, 1.5)}" stroke-dasharray="${curve.dash.join(" ")}"/>`;
        const value = element("span", { class: "himap-value" });
        const button = element("button", { type: "button", "aria-pressed": String(!this.hidden.has(curve.label)), onclick: () => this.toggle(curve, button) });
        button.innerHTML = `<svg width="28" height="12" aria-hidden="true">${dots}</svg>`;
        button.append(` ${curve.label} `, value);
        this.legend.append(button);
      });
    }

    toggle(curve, button) {
      const show = this.hidden.has(curve.label);
      if (show) this.hidden.delete(curve.label);
      else this.hidden.add(curve.label);
      button.setAttribute("aria-pressed", String(show));
      const at = this.shown.curves.indexOf(curve);
      this.charts.forEach((chart) => himapChart.show(chart, at, show));
    }

    /* A number of each curve at the cursor: its ratio where there is one. */
    moved(chart) {
      const { idx } = chart.cursor;
      const values = [...this.legend.querySelectorAll(".himap-value")];
      this.shown.curves.forEach((curve, n) => {
        if (values[n]) values[n].textContent = idx === null || idx === undefined ? "" : himapChart.text(this.valueOf(curve, idx));
      });
    }

    valueOf(curve, at) {
      const ys = this.ratioLabel(this.shown) ? curve.ratio || [] : curve.y;
      return ys[at] ?? null;
    }

    point(at, aloud = true) {
      const { shown } = this;
      const index = Math.max(0, Math.min(shown.x.length - 1, at));
      const [first] = this.charts;
      first.setCursor({ left: first.valToPos(shown.x[index], "x"), top: 10 });
      this.at = index;
      if (!aloud) return;
      const said = shown.curves.filter((curve) => !this.hidden.has(curve.label) && this.valueOf(curve, index) !== null);
      const what = this.ratioLabel(shown);
      this.status.textContent = `${what ? `${what} at ` : ""}${shown.x_label.split(" [")[0]} = ${himapChart.text(shown.x[index])}: ${said.map((curve) => `${curve.label} ${himapChart.text(this.valueOf(curve, index))}`).join("; ")}`;
    }

    press(event) {
      const step = event.shiftKey ? 10 : 1;
      const at = this.at ?? -1;
      const does = {
        ArrowRight: () => this.point(at + step),
        ArrowLeft: () => this.point(at - step),
        Home: () => this.point(0),
        End: () => this.point(this.shown.x.length - 1),
        "+": () => this.charts.forEach((chart) => himapChart.zoom(chart, 0.6)),
        "-": () => this.charts.forEach((chart) => himapChart.zoom(chart, 1 / 0.6)),
        0: () => this.charts.forEach(himapChart.reset),
      }[event.key];
      if (!does || event.ctrlKey || event.metaKey) return;
      event.preventDefault();
      does();
    }

    explain() {
      const what = this.ratioLabel(this.shown);
      const ensembles = this.shown.curves.some((curve) => curve.spread.length);
      this.note.textContent = "Drag over a stretch of the curves to zoom, double-click for the whole range." +
        (what ? ` Numbers beside the curves’ names are ${what} under the pointer.` : "") +
        (ensembles ? " Of restarts the median, the band from 16 to 84 %, and each as a thin line." : "");
    }
  }

  function start(name, content) {
    const { button } = waiting[name];
    const figure = button.closest("figure");
    const player = new Player(name, content);
    figure.querySelector("figcaption").before(player.box);
    waiting[name].player = player;
    show(name, true);
    const redraw = () => figure.classList.contains("himap-playing") && player.draw();
    new MutationObserver(redraw).observe(document.documentElement, { attributeFilter: ["data-theme"] });
    let width = window.innerWidth;
    window.addEventListener("resize", () => {
      if (window.innerWidth !== width) redraw();
      width = window.innerWidth;
    });
  }

  function show(name, playing) {
    const { button, player } = waiting[name];
    button.closest("figure").classList.toggle("himap-playing", playing);
    button.textContent = playing ? BACK : PLAY;
    button.setAttribute("aria-expanded", String(playing));
    if (playing) player.draw();
    else player.clear();
  }

  function pressed(name) {
    const { button, player } = waiting[name];
    if (player) return show(name, !button.closest("figure").classList.contains("himap-playing"));
    if (waiting[name].asked) return;
    waiting[name].asked = true;
    document.head.append(element("script", { src: new URL(`play/${name}.js`, base).href }));
  }

  for (const button of document.querySelectorAll("button.himap-play")) {
    const name = button.dataset.figure;
    waiting[name] = { button };
    button.textContent = PLAY;
    button.setAttribute("aria-expanded", "false");
    button.addEventListener("click", () => pressed(name));
    button.hidden = false;
  }

  return { arrived: start };
})();
