// Draws curves with ECharts, which comes with NiceGUI: hover, zoom, one cursor for all. Texts go in as text.
const FIRST = 4; // curves before "more"
const MODES_PX = 18;

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const dark = matchMedia("(prefers-color-scheme: dark)");

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

const day = (ms) => new Date(ms).toISOString().slice(0, 10);
const short = (value) => (value === null || value === undefined ? "–" : String(Number(value.toPrecision(3))));

// The cursor's values. ECharts takes an element as it is; a text would be markup.
function tip(chart, modes, trend, rows) {
  const box = document.createElement("div");
  const row = rows.find((one) => one.seriesName === "value") ?? rows[0];
  if (!row) return box;
  const at = row.dataIndex;
  const time = chart.time[at];
  const mode = modes.find(([begin, end]) => begin <= time && time < end)?.[2];
  const title = trend ? `flight ${chart.flights[at]}, ${day(time)}` : clock(time) + (mode ? `, ${mode}` : "");
  made("strong", title, box);
  made("div", `${short(chart.value[at])}${chart.low[at] === chart.high[at] ? "" : ` (${short(chart.low[at])} to ${short(chart.high[at])})`}`, box);
  if (chart.demanded) made("div", `demanded ${short(chart.demanded[at])}`, box);
  return box;
}

// Labels beside the curve, each at its level or as near below it as the one above leaves room.
function labels(chart, plotPx) {
  const [low, high] = chart.range;
  let below = -Infinity;
  return [...chart.limits]
    .sort((a, b) => b.value - a.value)
    .map((limit) => {
      const at = ((high - limit.value) / (high - low)) * plotPx;
      below = Math.max(at, below + 15);
      return { yAxis: limit.value, label: { formatter: () => limit.label, offset: [0, below - at] } };
    });
}

function stretch(modes, look) {
  return (params, api) => {
    const [begin, end, name] = modes[api.value(2)];
    const [x0] = api.coord([begin, 0]);
    const [x1] = api.coord([end, 0]);
    const grid = params.coordSys;
    const from = Math.max(x0, grid.x);
    const wide = Math.min(x1, grid.x + grid.width) - from;
    if (wide <= 0) return null;
    const box = { x: from, y: grid.y, width: wide, height: grid.height };
    return {
      type: "group",
      children: [
        { type: "rect", shape: box, style: { fill: look.ground, stroke: look.rule } },
        {
          type: "text",
          style: { x: from + 4, y: grid.y + 3, text: name, fill: look.text, fontSize: 12, width: wide - 6, overflow: "truncate", ellipsis: "" },
        },
      ],
    };
  };
}

function option(chart, whole) {
  const look = {
    text: colour("--quiet"), rule: colour("--rule"), blue: colour("--blue"), band: colour("--band"),
    limit: colour("--limit"), ground: colour("--card"), strong: colour("--text"),
  };
  const trend = Boolean(chart.flights);
  const modes = (!trend && whole.modes?.[chart.vehicle]) || [];
  const right = chart.limits.length ? 92 : 16;
  const below = modes.length ? MODES_PX + 6 : 0;
  const plotPx = 260 - 42 - 28 - below;
  const points = (values) => chart.time.map((time, place) => [time, values[place]]);
  const line = (name, values, style) => ({
    name, type: "line", data: points(values), symbol: "none", showSymbol: false, animation: false,
    connectNulls: false, lineStyle: { color: look.blue, width: 2 }, silent: true, ...style,
  });
  const rise = chart.high.map((value, place) => (value === null ? null : value - chart.low[place]));
  const marks = [
    ...(chart.since ? [{ xAxis: chart.since, text: `since ${clock(chart.since)}` }] : []),
    ...(chart.marks ?? []).map((mark) => ({ xAxis: mark.at, text: mark.text })),
  ];
  const time = {
    type: trend ? "time" : "value", axisLine: { lineStyle: { color: look.rule } },
    axisLabel: { color: look.text, hideOverlap: true, ...(trend ? { formatter: (ms) => day(ms) } : { formatter: clock }) },
    splitLine: { show: false }, axisPointer: { label: { show: false } },
    ...(trend ? { minInterval: 864e5 } : { min: 0, max: whole.duration }),
  };
  const [low, high] = chart.range;
  const round = high - low > 0 ? 10 ** Math.floor(Math.log10(high - low) - 1) : 1;
  return {
    animation: false,
    textStyle: { fontFamily: "system-ui, sans-serif" },
    grid: [
      { left: 52, right, top: 42, bottom: 28 + below },
      ...(modes.length ? [{ left: 52, right, height: MODES_PX, bottom: 2 }] : []),
    ],
    xAxis: [time, ...(modes.length ? [{ gridIndex: 1, type: "value", min: 0, max: whole.duration, show: false, axisPointer: { show: false } }] : [])],
    yAxis: [
      {
        type: "value", min: Math.floor(low / round) * round, max: Math.ceil(high / round) * round,
        axisLabel: { color: look.text, formatter: short, showMinLabel: low === 0, showMaxLabel: false }, splitLine: { lineStyle: { color: look.rule } },
      },
      ...(modes.length ? [{ gridIndex: 1, type: "value", min: 0, max: 1, show: false }] : []),
    ],
    tooltip: {
      trigger: "axis", confine: true, backgroundColor: look.ground, borderColor: look.rule, textStyle: { color: look.strong },
      axisPointer: { lineStyle: { color: look.strong } }, formatter: (rows) => tip(chart, modes, trend, [rows].flat()),
    },
    toolbox: {
      right: 0, top: -4, itemSize: 14, iconStyle: { borderColor: look.text },
      feature: { dataZoom: { yAxisIndex: "none", title: { zoom: "Zoom: drag over a part", back: "Zoom back" } }, restore: { title: "Show all" } },
    },
    dataZoom: [{ type: "inside", xAxisIndex: modes.length ? [0, 1] : [0], zoomOnMouseWheel: "ctrl", moveOnMouseMove: true, moveOnMouseWheel: false, preventDefaultMouseMove: false, filterMode: "none" }],
    series: [
      ...(chart.samples
        ? [{ ...line("samples", [], {}), data: chart.samples.time.map((t, place) => [t, chart.samples.value[place]]), lineStyle: { color: look.limit, width: 0.6 } }]
        : []),
      line("low", chart.low, { lineStyle: { opacity: 0 }, stack: "band", stackStrategy: "all", tooltip: { show: false } }),
      line("high", rise, { lineStyle: { opacity: 0 }, stack: "band", stackStrategy: "all", areaStyle: { color: look.band, opacity: 1 }, tooltip: { show: false } }),
      line("value", chart.value, {
        ...(trend ? { symbol: "circle", showSymbol: true, symbolSize: 8, itemStyle: { color: look.blue }, silent: false, cursor: "pointer" } : {}),
        markLine: {
          silent: true, symbol: "none", animation: false,
          lineStyle: { color: look.limit, type: [7, 4], width: 1.5 },
          label: { color: look.limit, fontWeight: 600, position: "end", distance: 6, fontSize: 13, align: "left" },
          data: [
            ...labels(chart, plotPx),
            ...marks.map((mark) => ({
              xAxis: mark.xAxis, lineStyle: { color: look.strong, type: [2, 3], width: 1 },
              label: { formatter: () => mark.text, color: look.text, fontWeight: 400, align: "center", distance: 4 },
            })),
          ],
        },
      }),
      ...(chart.demanded ? [line("demanded", chart.demanded, { lineStyle: { color: look.strong, width: 1.5, type: [5, 3] } })] : []),
      ...(modes.length
        ? [{ type: "custom", xAxisIndex: 1, yAxisIndex: 1, silent: true, animation: false, clip: true, tooltip: { show: false }, renderItem: stretch(modes, look), data: modes.map(([begin, end], place) => [begin, end, place]), encode: { x: [0, 1] } }]
        : []),
    ],
  };
}

// The track from above, north up, in metres from its first place; one scale for both directions.
function map(track, box) {
  const look = { text: colour("--quiet"), rule: colour("--rule") };
  const [xs, ys] = [track.map((at) => at[1]), track.map((at) => at[2])];
  const middle = (values) => (Math.min(...values) + Math.max(...values)) / 2;
  const span = (values) => Math.max(...values) - Math.min(...values) || 1;
  const [width, height] = [box.clientWidth - 90, box.clientHeight - 60];
  const scale = 1.05 * Math.max(span(xs) / width, span(ys) / height);
  const axis = (values, px, name) => ({
    type: "value", min: middle(values) - (scale * px) / 2, max: middle(values) + (scale * px) / 2, name, nameLocation: "middle", nameGap: 28,
    axisLabel: { color: look.text, formatter: (m) => `${Math.round(m)}`, showMinLabel: false, showMaxLabel: false }, nameTextStyle: { color: look.text }, splitLine: { lineStyle: { color: look.rule } },
  });
  const parts = [];
  track.forEach((at, place) => {
    if (!parts.length || parts.at(-1).condition !== at[3]) parts.push({ condition: at[3], data: place ? [track[place - 1]] : [] });
    parts.at(-1).data.push(at);
  });
  const tone = (condition) => {
    const probe = made("span", "", document.body, condition);
    const found = getComputedStyle(probe).getPropertyValue("--c").trim();
    probe.remove();
    return found;
  };
  return {
    animation: false, textStyle: { fontFamily: "system-ui, sans-serif" },
    grid: { left: 60, right: 30, top: 15, bottom: 45 },
    xAxis: axis(xs, width, "m east"), yAxis: { ...axis(ys, height, "m north"), nameGap: 42 },
    tooltip: { trigger: "item", formatter: (row) => made("div", `${clock(row.data[2])}: ${row.seriesName}`) },
    series: parts.map((part) => ({
      name: part.condition, type: "line", symbol: "circle", symbolSize: 5, animation: false, data: part.data.map(([s, x, y]) => [x, y, s]),
      itemStyle: { color: tone(part.condition), opacity: 0 }, emphasis: { itemStyle: { opacity: 1 } }, lineStyle: { color: tone(part.condition), width: 3 },
    })),
  };
}

async function draw(box, described, options, clicked) {
  const { echarts } = await import("nicegui-echart");
  if (!box.isConnected) return;
  box.setAttribute("role", "img");
  box.setAttribute("aria-label", described);
  const shown = echarts.init(box, null, { renderer: "svg" });
  shown.group = "one cursor";
  echarts.connect(shown.group);
  const again = () => {
    if (!box.isConnected) {
      watch.disconnect();
      dark.removeEventListener("change", again);
      shown.dispose();
      return;
    }
    shown.resize();
    shown.setOption(options(box), true);
  };
  const watch = new ResizeObserver(again);
  watch.observe(box);
  dark.addEventListener("change", again);
  if (clicked) shown.on("click", clicked);
}

function figure(chart, whole, parent) {
  const place = made("figure", "", parent);
  made("h3", chart.title, place);
  if (chart.life) made("p", chart.life, place);
  const box = made("div", "", place, "chart");
  made("figcaption", chart.caption, place);
  const opened = chart.links && ((event) => event.seriesName === "value" && location.assign(chart.links[event.dataIndex]));
  draw(box, `${chart.title}: ${chart.caption}`, () => option(chart, whole), opened);
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
  for (const [vehicle, track] of Object.entries(whole.tracks ?? {})) {
    if (track.length < 2) continue;
    const several = Object.keys(whole.tracks).length > 1;
    more(`The track from above, by condition${several ? `, vehicle ${vehicle}` : ""}`, place, (inner) => {
      const figured = made("figure", "", inner);
      draw(made("div", "", figured, "chart", "map"), "The track from above, in the colours of the gravest condition", (box) => map(track, box));
      made("figcaption", `Line: the gravest condition of all actuators at that time (${[...new Set(track.map((at) => at[3]))].join(", ")}). The report has no position.`, figured);
    });
  }
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
window.addEventListener("load", () => setTimeout(() => import("nicegui-echart"), 200));
