"use strict";
// Draws the plots of a page in the colours of its stylesheet, again whenever these change.
const root = document.documentElement;
const plots = JSON.parse(document.getElementById("plots").textContent);
const flatButtons = [["zoom2d", "pan2d", "resetScale2d", "toImage"]];
const spaceButtons = [["orbitRotation", "pan3d", "resetCameraDefault3d", "toImage"]];
const config = {responsive: true, displaylogo: false, displayModeBar: "hover", toImageButtonOptions: {format: "svg"}};
const hidden = new Set();

function colour(name) { return getComputedStyle(root).getPropertyValue("--" + name).trim(); }

function axisStyle(axis) {
  return {...axis, gridcolor: colour("grid"), linecolor: colour("rule"), zerolinecolor: colour("grid"),
    tickcolor: colour("rule"), tickfont: {size: 12},
    title: {...axis.title, font: {size: 13}}, backgroundcolor: "rgba(0,0,0,0)", ticks: "outside"};
}

function traceStyle(trace) {
  const shown = {...trace, visible: !hidden.has(trace.legendgroup)};
  if (trace.meta === "ink" || trace.meta === "muted") shown.line = {...trace.line, color: colour(trace.meta)};
  if (trace.type === "heatmap") {
    const title = {...trace.colorbar.title, font: {size: 13}};
    shown.colorbar = {...trace.colorbar, title, thickness: 12, outlinewidth: 0};
  }
  if (trace.meta === "arrow") {
    const bar = {title: {text: "lost or late (%)", side: "right", font: {size: 13}}, thickness: 12, outlinewidth: 0};
    shown.marker = {...trace.marker, symbol: "triangle-up", line: {color: colour("paper"), width: 1}, colorbar: bar};
  }
  if (trace.meta === "node") {
    shown.marker = {size: 24, color: colour("paper"), line: {...trace.marker.line, width: 3}};
    shown.textfont = {size: 11};
  }
  return shown;
}

function layoutStyle(layout) {
  const font = {family: getComputedStyle(document.body).fontFamily, size: 13, color: colour("ink")};
  const clear = "rgba(0,0,0,0)";
  const styled = {margin: {l: 72, r: 16, t: 34, b: 46}, hovermode: "closest", uirevision: "kept", ...layout, font,
    paper_bgcolor: clear, plot_bgcolor: clear,
    modebar: {bgcolor: clear, color: colour("muted"), activecolor: colour("ink")},
    legend: {orientation: "h", traceorder: "normal", x: 0, y: 1.01, yanchor: "bottom", font: {size: 13}, bgcolor: clear}};
  if (layout.scene) {
    styled.scene = {...layout.scene, camera: {eye: {x: 1.45, y: -1.75, z: 0.9}, center: {x: 0, y: 0, z: -0.12}}};
    for (const name of ["xaxis", "yaxis", "zaxis"]) styled.scene[name] = axisStyle(layout.scene[name]);
    styled.margin = {l: 0, r: 0, t: 34, b: 0};
  }
  for (const name of ["xaxis", "yaxis"]) if (layout[name]) styled[name] = {...axisStyle(layout[name]), zeroline: false};
  styled.annotations = (layout.annotations || []).map(note => ({...note, font: {size: 11.5, color: colour("muted")}}));
  return styled;
}

function hasWebGL() {
  const canvas = document.createElement("canvas");
  return Boolean(canvas.getContext("webgl2") || canvas.getContext("webgl"));
}

function draw() {
  for (const [name, plot] of Object.entries(plots)) {
    const place = document.getElementById("plot-" + name);
    if (plot.layout.scene && !hasWebGL()) {
      place.textContent = "This browser has no WebGL, so the view in three dimensions is left out; the view from above shows the same run.";
      place.style.height = "auto";
      continue;
    }
    // On a phone each name of a legend has a line of its own, and a legend takes half of a plot at most.
    const named = plot.data.filter(trace => trace.showlegend !== false && trace.name).length;
    place.style.height = plot.layout.xaxis && innerWidth <= 640 && named > 8 ? `${42 * named}px` : "";
    Plotly.react(place, plot.data.map(traceStyle), layoutStyle(plot.layout),
      {...config, modeBarButtons: plot.layout.scene ? spaceButtons : flatButtons});
  }
}

const buttons = [...document.querySelectorAll("#agents button")];

function show() {
  for (const button of buttons) button.setAttribute("aria-pressed", String(!hidden.has(button.dataset.group)));
  draw();
}

for (const button of buttons) {
  const group = button.dataset.group;
  button.addEventListener("click", () => { hidden.has(group) ? hidden.delete(group) : hidden.add(group); show(); });
  button.addEventListener("dblclick", () => {
    const others = buttons.map(each => each.dataset.group).filter(each => each !== group);
    const alone = others.every(each => hidden.has(each));
    hidden.clear();
    if (!alone) for (const each of others) hidden.add(each);
    show();
  });
}

function printing(on) {
  root.classList.toggle("printing", on);
  draw();
  for (const place of document.querySelectorAll(".js-plotly-plot")) Plotly.Plots.resize(place);
}

async function start() {
  if (document.getElementById("plotly")) {
    const script = document.createElement("script");
    script.textContent = new TextDecoder().decode(await enclosed("plotly"));
    document.head.append(script);
  }
  window.addEventListener("beforeprint", () => printing(true));
  window.addEventListener("afterprint", () => printing(false));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  draw();
}

start().catch(() => {
  for (const place of document.querySelectorAll(".plot")) place.textContent = "This browser cannot unpack the plots; one of 2023 or later can.";
});
