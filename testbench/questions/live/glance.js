"use strict";
const at = (id) => document.getElementById(id);
const POLL_MS = 500, LOST_MS = 3000;
let heard = performance.now(), time = null, stops = null, sound = null;

function percent(x) {
  return (x >= 99.5 ? ">99" : x >= 9.95 ? x.toFixed(0) : x.toFixed(1)) + " %";
}

function items(list, rows, fill) {
  while (list.children.length > rows.length) list.lastElementChild.remove();
  rows.forEach((row, k) => {
    const item = list.children[k] || list.appendChild(document.createElement("li"));
    fill(item, row);
  });
}

function parts(item, texts) {
  const key = JSON.stringify(texts);
  if (item.dataset.key === key) return;
  item.dataset.key = key;
  item.replaceChildren(...texts.map(([tag, text]) => Object.assign(document.createElement(tag), { textContent: text })));
}

function say(id, text) {
  if (at(id).textContent !== text) at(id).textContent = text;
}

function alarm() {
  if (!sound) return;
  for (let k = 0; k < 3; k++) {
    const tone = sound.createOscillator(), level = sound.createGain(), t = sound.currentTime + 0.35 * k;
    tone.frequency.value = 880;
    level.gain.setValueAtTime(0.5, t);
    level.gain.setValueAtTime(0, t + 0.22);
    tone.connect(level).connect(sound.destination);
    tone.start(t);
    tone.stop(t + 0.25);
  }
  if (window.speechSynthesis) speechSynthesis.speak(new SpeechSynthesisUtterance("stop"));
}

function show(now) {
  at("state").className = now.kind;
  say("word", now.word);
  say("line", now.line);
  say("time", now.t_s.toFixed(0) + " s");
  say("left", now.left_s === null ? "" : Math.ceil(now.left_s / 60) + " min of flight left");
  say("brings", now.brings);
  items(at("known"), now.derivatives, (item, d) => {
    item.className = d.reached ? "reached" : "";
    parts(item, [["span", d.name], ["b", percent(d.error)],
                 ["small", d.reached ? "as wanted" : percent(d.wanted) + " is wanted, " + d.more]]);
  });
  items(at("calls"), now.calls, (item, [t, words]) => parts(item, [["b", t.toFixed(0) + " s "], ["span", words]]));
  if (stops !== null && now.stops > stops) alarm();
  stops = now.stops;
}

async function poll() {
  try {
    const now = await (await fetch("now")).json();
    if (now !== null && now.t_s !== time) {
      heard = performance.now();
      time = now.t_s;
      show(now);
    }
  } catch (error) { /* said below, once it has lasted */ }
  if (performance.now() - heard > LOST_MS) {
    at("state").className = "lost";
    say("word", "NO DATA");
    say("line", "nothing new for " + Math.round((performance.now() - heard) / 1000) + " s");
  }
  setTimeout(poll, POLL_MS);
}

at("sound").addEventListener("click", () => {
  sound = sound ? void sound.close() || null : new AudioContext();
  at("sound").setAttribute("aria-pressed", String(sound !== null));
  say("sound", sound ? "Sound on" : "Sound off");
});
poll();
