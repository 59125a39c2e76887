// Uploads with progress, and the search in a list. Texts go in as text, never as markup.
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
  for (const file of files) {
    const shown = line(file.name);
    if (file.size > limit) refuse(shown, file.name, `larger than ${Math.floor(limit / 1e6)} MB, the limit of this page`, "judge it with mavhums analyse");
    else waiting.push({ file, shown });
  }
  next();
}

function next() {
  while (running < AT_ONCE && waiting.length) send(waiting.shift());
}

function send({ file, shown }) {
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
    if (request.status === 200) shown.item.remove();
    else {
      let told = { problem: request.responseText.slice(0, 300) || `the server answers ${request.status}`, remedy: "" };
      try {
        told = JSON.parse(request.responseText);
      } catch {
        // not ours: shown as it is
      }
      refuse(shown, file.name, told.problem, told.remedy);
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
  for (const row of document.querySelectorAll("table.fleet tbody tr")) {
    const text = row.textContent.toLowerCase();
    row.hidden = !words.every((word) => text.includes(word));
  }
});
