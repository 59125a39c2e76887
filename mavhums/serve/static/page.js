// Uploads with progress, the list of logs and the answer below it, and the search in a list. Texts go in as
// text; markup is what the server's templates have escaped.
"use strict";

const AT_ONCE = 2;
const waiting = [];
let running = 0;

function said(text) {
  const place = document.querySelector("[data-said]");
  if (place) place.textContent = text;
}

function line(name) {
  const item = document.createElement("li");
  const title = document.createElement("span");
  const bar = document.createElement("progress");
  const text = document.createElement("span");
  title.className = "name";
  title.textContent = name;
  bar.max = 100;
  bar.value = 0;
  bar.setAttribute("aria-label", `Uploading ${name}`);
  text.textContent = " waiting";
  item.append(title, " ", bar, text);
  document.querySelector("[data-uploads]").append(item);
  return { item, bar, text };
}

function refuse(shown, name, problem, remedy) {
  shown.bar.remove();
  shown.item.classList.add("refused");
  shown.text.textContent = ` ! refused: ${problem}${remedy ? `. To do: ${remedy}` : ""} `;
  const button = document.createElement("button");
  button.type = "button";
  button.textContent = "Dismiss";
  button.addEventListener("click", () => shown.item.remove());
  shown.item.append(button);
  said(`${name} refused: ${problem}`);
}

function add(files) {
  const limit = Number(document.querySelector("[data-drop]").dataset.limit);
  if (files.length > 1) below.chosen = false; // of several the worst is shown
  for (const file of files) {
    const shown = line(file.name);
    if (file.size > limit) refuse(shown, file.name, `larger than ${Math.floor(limit / 1e6)} MB, the limit of this page`, "judge it with mavhums analyse");
    else waiting.push({ file, shown, alone: files.length === 1 });
  }
  next();
}

function next() {
  while (running < AT_ONCE && waiting.length) send(waiting.shift());
}

function send({ file, shown, alone }) {
  running += 1;
  const request = new XMLHttpRequest();
  const end = () => {
    running -= 1;
    next();
  };
  request.open("POST", `/logs?name=${encodeURIComponent(file.name)}`);
  request.upload.addEventListener("progress", (event) => {
    const percent = Math.floor((100 * event.loaded) / Math.max(event.total, 1));
    shown.bar.value = percent;
    shown.text.textContent = ` ${percent} %`;
  });
  request.addEventListener("load", () => {
    if (request.status === 200) {
      shown.item.remove();
      if (alone) below.next = JSON.parse(request.responseText).id;
      look();
    }
    else {
      let refusal = { problem: request.responseText.slice(0, 300) || `the server answers ${request.status}`, remedy: "" };
      try {
        refusal = JSON.parse(request.responseText);
      } catch {
        // not ours: shown as it is
      }
      refuse(shown, file.name, refusal.problem, refusal.remedy);
    }
    end();
  });
  request.addEventListener("error", () => {
    refuse(shown, file.name, "the link to mavhums broke, or the file cannot be read", "drop it again");
    end();
  });
  request.send(file);
}

function zone(event) {
  return event.target.closest?.("[data-drop]");
}

document.addEventListener("change", (event) => {
  if (!event.target.matches?.("[data-drop] input")) return;
  add(event.target.files);
  event.target.value = "";
});
document.addEventListener("dragover", (event) => {
  event.preventDefault();
  zone(event)?.classList.add("over");
});
document.addEventListener("dragleave", (event) => zone(event)?.classList.remove("over"));
document.addEventListener("drop", (event) => {
  event.preventDefault();
  zone(event)?.classList.remove("over");
  if (document.querySelector("[data-drop]")) add(event.dataTransfer.files);
});

document.addEventListener("click", async (event) => {
  if (!event.target.matches?.("[data-example]")) return;
  const name = "example.tlog.xz";
  try {
    const answer = await fetch(`/static/${name}`);
    if (!answer.ok) throw new Error(answer.status);
    add([new File([await answer.blob()], name)]);
  } catch {
    refuse(line(name), name, "the example cannot be fetched", "reload the page");
  }
});

document.addEventListener("input", (event) => {
  if (!event.target.matches?.("[data-find]")) return;
  const words = event.target.value.toLowerCase().split(/\s+/);
  for (const row of document.querySelectorAll("table tbody tr")) {
    const text = row.textContent.toLowerCase();
    row.hidden = !words.every((word) => text.includes(word));
  }
});

// What is shown below the list: a log and its part, "answer" or "view"; chosen once the user has said which.
// A log that came alone is shown next. The address has the log, so that the page opens again where it was.
const below = { log: "", part: "", beside: "", next: new URLSearchParams(location.hash.slice(1)).get("log") ?? "", chosen: false, waits: false };
let known = ""; // the list as it came last
let timer;

async function look() {
  const place = document.querySelector("[data-logs]");
  if (!place) return;
  clearTimeout(timer);
  let every = 1000;
  try {
    const answer = await fetch(`/logs?log=${below.log}&shown=${below.part}&beside=${below.beside}`);
    if (answer.ok) every = list(place, await answer.text());
  } catch {
    // the server has ended, or the link broke: the next look may find it
  }
  clearTimeout(timer);
  timer = setTimeout(look, every);
}

function list(place, markup) {
  if (markup !== known) {
    const fresh = document.createElement("template");
    fresh.innerHTML = markup;
    for (const item of fresh.content.querySelectorAll("li")) item.source = item.outerHTML;
    if (place.children.length) merge(place, fresh.content);
    else place.append(fresh.content);
    known = markup;
  }
  const { worst, every } = place.querySelector("[data-worst]").dataset;
  const next = document.querySelector(`#log-${CSS.escape(below.next)} [data-do=answer]`);
  if (below.beside && !document.getElementById(`log-${below.beside}`)) beside("");
  if (next) {
    Object.assign(below, { next: "", chosen: true });
    show(next.dataset.log, "answer", false, false).then(look);
  }
  else if (below.log && !document.getElementById(`log-${below.log}`)) show("", "");
  else if (!below.chosen && worst && worst !== below.log) show(worst, "answer");
  else if (below.waits) show(below.log, below.part, true);
  return Number(every);
}

// Only what has changed is replaced, so that a name half typed and the keyboard's place stay.
function merge(place, fresh) {
  const [heading, logs] = [place.children[0], place.children[1]];
  const [newHeading, newLogs] = [fresh.children[0], fresh.children[1]];
  heading.replaceWith(newHeading);
  logs.className = newLogs.className;
  const items = [...newLogs.children].map((item) => {
    const old = document.getElementById(item.id);
    if (!old) return item;
    if (old.source === item.source) return old;
    const focused = old.contains(document.activeElement) && document.activeElement.dataset.do;
    if (focused) setTimeout(() => item.querySelector(`[data-do=${focused}]`)?.focus());
    return item;
  });
  if (items.length !== logs.children.length || items.some((item, at) => item !== logs.children[at])) logs.replaceChildren(...items);
}

async function show(log, part, again = false, moves = below.chosen) {
  if (log !== below.log || part !== below.part) beside("");
  const address = new URLSearchParams(location.hash.slice(1));
  if (log && log !== address.get("log")) history.replaceState(null, "", `#log=${log}`);
  Object.assign(below, { log, part });
  const place = document.querySelector("[data-shown]");
  if (!log) {
    below.waits = false;
    place.replaceChildren();
    return;
  }
  const answer = await fetch(`/logs/${log}/${part}`);
  const markup = await answer.text();
  if (below.log !== log || below.part !== part) return; // the user has chosen another while it came
  if (!answer.ok) {
    if (part === "view") show(log, "answer"); // the list says why there is no view
    return;
  }
  below.waits = markup.includes("data-waits");
  if (again && below.waits) return;
  place.innerHTML = markup;
  if (!moves || again) return;
  const here = place.querySelector("h2"); // a long list of logs is above it
  here.scrollIntoView();
  here.focus({ preventScroll: true });
}

// Two answers side by side: the one below the list, and another log's.
async function beside(log) {
  below.beside = log;
  const place = document.querySelector("[data-beside]");
  const answer = log && (await fetch(`/logs/${log}/answer`));
  if (below.beside !== log) return;
  place.innerHTML = answer && answer.ok ? await answer.text() : "";
  place.querySelector("h2")?.scrollIntoView();
}

function ask(log, what) {
  fetch(`/logs/${log}/${what}`, { method: "POST" }).then(look, look);
  setTimeout(look, 50); // keeping may take long, and the list says so
}

document.addEventListener("click", (event) => {
  const button = event.target.closest?.("[data-do]");
  if (!button) return;
  const { log, do: what } = button.dataset;
  if (what === "keep" || what === "remove") ask(log, what);
  else if (what === "beside") beside([below.log, below.beside].includes(log) ? "" : log).then(look);
  else {
    below.chosen = true;
    show(log, what).then(look);
  }
});

document.addEventListener("submit", (event) => {
  if (!event.target.matches?.(".asked")) return;
  event.preventDefault();
  const name = new FormData(event.target).get("aircraft").trim();
  if (name) ask(event.target.dataset.log, `keep?aircraft=${encodeURIComponent(name)}`);
});

for (const place of document.querySelectorAll("[data-now]"))
  setInterval(async () => {
    try {
      const answer = await fetch(place.dataset.now);
      const markup = await answer.text();
      if (answer.ok && markup !== place.source) place.innerHTML = place.source = markup;
    } catch {
      // the next time may succeed
    }
  }, Number(place.dataset.every));

look();
