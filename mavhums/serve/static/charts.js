// Draws curves with Plotly: hover, zoom, one cursor for all. Texts go in as text.
const FIRST = 4; // curves before "more"

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const dark = matchMedia("(prefers-color-scheme: dark)");
let plotly;

function library() {
  plotly ??= new Promise((loaded, failed) => {
    const script = made("script", "", document.head);
    script.addEventListener("load", () => loaded(globalThis.Plotly ?? globalThis.moduleName));
    script.addEventListener("error", failed);
    script.src = "/static/plotly.min.js";
  });
  return plotly;
}

function made(tag, text, parent, ...classes) {
  const element = document.createElement(tag);
  if (text) element.textContent = text;
  element.classList.add(...classes);
  parent?.append(element);
  return element;
}

function clock(seconds) {
  const whole = Math.round(seconds * 10) / 10;
  if (whole < 60) return `${whole}s`;
  const [hours, minutes] = [Math.floor(whole / 3600), Math.floor((whole % 3600) / 60)];
  const rest = `${String(Math.floor(whole % 60)).padStart(2, "0")}s`;
  return hours ? `${hours}h${String(minutes).padStart(2, "0")}m` : `${minutes}m${rest}`;
}

// A moment of the flight in the address, as #t=285 or #t=4m45s: the page opens there, and a click names another.
function moment() {
  const parts = /^(?:(\d+)h)?(?:(\d+)m)?(?:([\d.]+)s?)?$/.exec(new URLSearchParams(location.hash.slice(1)).get("t") ?? "-");
  return parts ? 3600 * (parts[1] ?? 0) + 60 * (parts[2] ?? 0) + Number(parts[3] ?? 0) : undefined;
}

const AROUND_S = 60;
const openedAt = moment();
// The part of the flight that is shown first.
const span = (duration) => (openedAt <= duration ? [Math.max(openedAt - AROUND_S, 0), Math.min(openedAt + AROUND_S, duration)] : [0, duration]);

function setMoment(time) {
  const address = new URLSearchParams(location.hash.slice(1));
  address.set("t", String(Math.round(time * 10) / 10));
  history.replaceState(null, "", `#${address}`);
  for (const again of drawn.values()) again();
}

const day = (ms) => new Date(ms).toISOString().slice(0, 10);
const short = (value) => (value === null || value === undefined ? "–" : String(Number(value.toPrecision(3))));

const DAY_MS = 864e5;
const text = (value) => value.replaceAll("&", "&amp;").replaceAll("<", "&lt;"); // Plotly takes some tags

function look() {
  return {
    text: colour("--quiet"), rule: colour("--rule"), blue: colour("--blue"), band: colour("--band"),
    limit: colour("--limit"), ground: colour("--card"), strong: colour("--text"),
  };
}

function layout(tones, more) {
  return {
    font: { family: "system-ui, sans-serif", color: tones.text, size: 12 },
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", showlegend: false, dragmode: "zoom", uirevision: "zoom",
    hoverlabel: { bgcolor: tones.ground, bordercolor: tones.rule, font: { color: tones.strong } },
    modebar: { color: tones.text, activecolor: tones.strong, bgcolor: "rgba(0,0,0,0)" }, ...more,
  };
}

// Ticks of a time in seconds at round clock times; Plotly's own would be powers of ten.
function ticks(duration) {
  const step = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400].find((s) => duration / s <= 7) ?? 28800;
  const values = Array.from({ length: Math.floor(duration / step) + 1 }, (_, place) => place * step);
  return { tickvals: values, ticktext: values.map(clock) };
}

// What the cursor shows of a time.
function hoverText(chart, modes, events, at) {
  const time = chart.time[at];
  const mode = modes.find(([begin, end]) => begin <= time && time < end)?.[2];
  const title = chart.flights ? `flight ${chart.flights[at]}, ${day(time)}` : clock(time) + (mode ? `, ${mode}` : "");
  const happened = events.filter((one) => Math.abs(one[0] - time) < events.near).map((one) => `<br>${clock(one[0])}: ${text(one[1])}`);
  const value = chart.value[at] === null ? "" : `<br>${short(chart.value[at])}${chart.low[at] === chart.high[at] ? "" : ` (${short(chart.low[at])} to ${short(chart.high[at])})`}`;
  return `<b>${text(title)}</b>${value}${chart.demanded ? `<br>dashed ${short(chart.demanded[at])}` : ""}${happened.join("")}`;
}

function curve(chart, whole) {
  const tones = look();
  const trend = Boolean(chart.flights);
  const modes = (!trend && whole.modes?.[chart.vehicle]) || [];
  const events = (!trend && whole.events?.[chart.vehicle]) || [];
  events.near = whole.duration / 100;
  const x = trend ? chart.time.map((ms) => new Date(ms)) : chart.time;
  const line = (y, style) => ({ type: "scatter", mode: "lines", x, y, hoverinfo: "skip", connectgaps: false, ...style });
  const data = [
    line(chart.low, { line: { width: 0 } }),
    line(chart.high, { line: { width: 0 }, fill: "tonexty", fillcolor: tones.band }),
    ...(chart.samples ? [line(chart.samples.value, { x: chart.samples.time, line: { color: tones.limit, width: 0.6 } })] : []),
    ...(chart.demanded ? [line(chart.demanded, { line: { color: tones.strong, width: 1.5, dash: "dash" } })] : []),
    line(chart.value, {
      mode: trend ? "lines+markers" : "lines", line: { color: tones.blue, width: 2 }, marker: { color: tones.blue, size: 8 },
      text: chart.time.map((_, at) => hoverText(chart, modes, events, at)), hoverinfo: "text",
    }),
  ];
  const across = (at) => ({ type: "line", xref: "paper", x0: 0, x1: 1, y0: at, y1: at, line: { color: tones.limit, width: 1.5, dash: "dash" } });
  const along = (at) => ({ type: "line", yref: "paper", y0: 0, y1: 1, x0: at, x1: at, line: { color: tones.strong, width: 1, dash: "dot" } });
  const marks = [
    ...(chart.since ? [{ at: chart.since, text: `since ${clock(chart.since)}` }] : []),
    ...(trend || moment() === undefined ? [] : [{ at: moment(), text: `at ${clock(moment())}` }]),
    ...(chart.marks ?? []).map((mark) => ({ at: new Date(mark.at), text: mark.text })),
  ];
  const happened = events.map(([at]) => ({ type: "line", yref: "paper", y0: 1, y1: 1.06, x0: at, x1: at, line: { color: tones.limit, width: 2 } }));
  const reference = (chart.reference ? [chart.reference] : []).map(([begin, end]) => ({ type: "rect", yref: "paper", y0: 0, y1: 1, x0: begin, x1: end, layer: "below", line: { width: 0 }, fillcolor: tones.rule, opacity: 0.45 }));
  const [low, high] = chart.range;
  // labels of limits: each at its level, or as near below it as the one above leaves room
  const plotPx = 190;
  let above = Infinity;
  const levels = [...chart.limits].sort((a, b) => b.value - a.value).map((limit) => {
    above = Math.min(limit.value, above - (15 / plotPx) * (high - low));
    return { xref: "paper", x: 1, xanchor: "left", y: above, text: ` ${text(limit.label)}`, showarrow: false, font: { color: tones.limit, size: 13 } };
  });
  const named = modes.map(([begin, end, name]) => ({ yref: "paper", y: 1.01, yanchor: "bottom", x: begin, xanchor: "left", text: (end - begin) / whole.duration > 0.02 * name.length ? text(name) : "", showarrow: false }));
  const stretches = modes.map(([begin, end], place) => ({ type: "rect", yref: "paper", y0: 1.01, y1: 1.11, x0: begin, x1: end, layer: "below", line: { width: 1, color: tones.rule }, fillcolor: place % 2 ? tones.ground : "rgba(0,0,0,0)" }));
  return {
    data,
    layout: layout(tones, {
      margin: { l: 52, r: chart.limits.length ? 92 : 16, t: 50, b: 28 }, hovermode: "x",
      xaxis: {
        gridcolor: "rgba(0,0,0,0)", linecolor: tones.rule, zeroline: false, showspikes: true, spikemode: "across", spikecolor: tones.strong, spikethickness: 1, spikedash: "solid",
        ...(trend ? { type: "date", tickformat: "%Y-%m-%d", nticks: 5, minallowed: new Date(chart.time[0] - 400 * DAY_MS) } : { range: span(whole.duration), ...ticks(whole.duration) }),
      },
      yaxis: { range: [low, high], gridcolor: tones.rule, zeroline: false, fixedrange: true },
      shapes: [...chart.limits.map((limit) => across(limit.value)), ...marks.map((mark) => along(mark.at)), ...stretches, ...happened, ...reference],
      annotations: [
        ...levels, ...named,
        ...marks.map((mark) => ({ yref: "paper", y: modes.length ? 1.11 : 1, yanchor: "bottom", x: mark.at, text: text(mark.text), showarrow: false })),
      ],
    }),
  };
}

// The other buttons are of no use here, and one shares the curve with a server.
const CONFIG = { displaylogo: false, responsive: true, displayModeBar: true, modeBarButtons: [["resetScale2d"]] };
const drawn = new Map(); // curves over time, and how each is drawn again: cursor and zoom of one are those of all
let following = false;

async function draw(box, described, figured, clicked) {
  const Plotly = await library();
  if (!box.isConnected) return;
  box.setAttribute("role", "group"); // its buttons may be reached
  box.setAttribute("aria-label", described);
  const { data, layout } = figured();
  await Plotly.newPlot(box, data, layout, CONFIG);
  const again = () => {
    if (box.isConnected) Plotly.react(box, ...Object.values(figured()), CONFIG);
    else dark.removeEventListener("change", again);
  };
  dark.addEventListener("change", again);
  box.on("plotly_click", (event) => clicked(event.points[0].pointIndex, event.points[0].x));
  drawn.set(box, again);
  let leads = false;
  box.on("plotly_hover", (event) => {
    if (!event.event) return; // one that another curve caused
    leads = true;
    for (const other of drawn.keys()) {
      if (!other.isConnected) drawn.delete(other);
      else if (other !== box) Plotly.Fx.hover(other, { xval: event.xvals[0] });
    }
  });
  box.on("plotly_relayout", async (change) => {
    const range = change["xaxis.range"] ?? [change["xaxis.range[0]"], change["xaxis.range[1]"]];
    if (following || range[0] === undefined) return;
    following = true;
    await Promise.all([...drawn.keys()].filter((other) => other !== box && other.isConnected).map((other) => Plotly.relayout(other, { "xaxis.range": range })));
    following = false;
  });
  box.on("plotly_unhover", () => {
    if (!leads) return;
    leads = false;
    for (const other of drawn.keys()) if (other !== box && other.isConnected) Plotly.Fx.unhover(other);
  });
}

// Opens the page of a flight, where it has one.
function open(place, link) {
  const page = JSON.parse(place.closest("[data-pages]").dataset.pages)[link];
  if (page) location.assign(page);
}

function figure(chart, whole, parent) {
  const place = made("figure", "", parent);
  made("h3", chart.title, place);
  if (chart.life) made("p", chart.life, place);
  const box = made("div", "", place, "chart");
  made("figcaption", chart.caption, place);
  const opened = chart.links ? (at) => open(place, chart.links[at]) : (_, time) => setMoment(time);
  draw(box, `${chart.title}: ${chart.caption}`, () => curve(chart, whole), opened);
}

function more(title, parent, fill) {
  const details = made("details", "", parent);
  made("summary", title, details);
  details.addEventListener("toggle", () => details.children.length === 1 && fill(made("div", "", details, "plots")));
}

function show(place, whole) {
  if (whole.problem) {
    made("p", `${whole.problem}${whole.remedy ? `. To do: ${whole.remedy}` : ""}`, place, "quiet");
    return;
  }
  const first = made("div", "", place, "plots");
  for (const chart of whole.charts.slice(0, FIRST)) figure(chart, whole, first);
  const rest = whole.charts.slice(FIRST);
  if (rest.length) more(`${rest.length} more ${rest.length > 1 ? "curves" : "curve"}`, place, (inner) => rest.forEach((chart) => figure(chart, whole, inner)));
}

async function begin(place) {
  place.dataset.begun = "";
  const given = place.dataset.charts;
  if (given) {
    show(place, JSON.parse(given));
    return;
  }
  const waits = made("p", "Drawing the curves …", place, "quiet");
  waits.setAttribute("role", "status");
  let whole;
  try {
    whole = await (await fetch(place.dataset.from)).json();
  } catch {
    whole = { problem: "the curves did not come", remedy: "load the page again" };
  }
  waits.remove();
  show(place, whole);
}

new MutationObserver(() => document.querySelectorAll(".curves:not([data-begun])").forEach(begin)).observe(document, { childList: true, subtree: true });
document.querySelectorAll(".curves:not([data-begun])").forEach(begin);
window.addEventListener("load", () => setTimeout(library, 200));
window.addEventListener("hashchange", () => drawn.forEach((again) => again()));
