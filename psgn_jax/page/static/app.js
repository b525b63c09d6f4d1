// The page: a photo, its mask, its points.

import { coloursFromView, networkInputs, normalForm, PhotoError, place } from "./framing.js";
import { Editor } from "./editor.js";
import { FORMATS } from "./files.js";
import { readPhoto } from "./photo.js";
import { bandHints, isPlausible, plain } from "./segment.js";
import { Viewer } from "./viewer.js";
import { Asked } from "./workers.js";

const SAMPLES = 8, PAUSE = 120;
const $ = id => document.getElementById(id);
const state = { name: "", clouds: [], sample: 0, about: null, request: 0 };

const network = new Asked("network_worker.js"), segmenter = new Asked("segment_worker.js");
const viewer = new Viewer($("cloud"));
const editor = new Editor($("photo"), { onchange: maskChanged, snap: (photo, hints) => snap(photo, hints).catch(complain) });

// --- messages ----------------------------------------------------------------------------------

function say(text, busy = false) {
  $("status").textContent = text;
  $("busy").hidden = !busy;
}

function complain(error) {
  const known = error instanceof PhotoError;
  if (!known) console.error(error);
  $("problem").textContent = error.message || "Something went wrong.";
  $("problem").hidden = false;
  say("");
}

const settle = () => { $("problem").hidden = true; };

/** Runs a step; an error is shown, and the page stays usable. */
const guarded = step => async (...values) => {
  try {
    return await step(...values);
  } catch (error) {
    complain(error);
  }
};

// --- a photo -----------------------------------------------------------------------------------

const openPhoto = guarded(async file => {
  settle();
  say("Reading the photo", true);
  const photo = await readPhoto(file);
  state.name = (file.name || "photo").replace(/\.[^.]*$/, "").replace(/[^\w-]+/g, "_") || "photo";
  document.body.classList.add("has-photo");
  forgetClouds();
  segmenter.photo = null;
  editor.open(photo, new Uint8Array(photo.width * photo.height));
  $("photo").focus({ preventScroll: true });
  await findObject();
});

const findObject = guarded(async () => {
  const { photo } = editor;
  say("Looking for the object", true);
  await new Promise(resolve => setTimeout(resolve)); // the photo is drawn first
  let mask = photo.alpha?.map(a => +(a > 127)) ?? null, how = "from its transparency";
  if (mask && !mask.includes(1)) throw new PhotoError("This image is fully transparent; expected an object.");
  if (!mask) {
    mask = plain(photo);
    how = "on a plain background";
    if (mask && !isPlausible(mask)) mask = null;
  }
  if (!mask) {
    mask = await snap(photo, bandHints(photo.width, photo.height));
    how = "by its colours";
    if (mask && !isPlausible(mask, 0.01)) mask = null;
  }
  if (photo !== editor.photo) return;
  if (!mask) {
    forgetClouds();
    say("No object was found: paint over the object with Snap.");
    return;
  }
  state.how = how;
  editor.replace(mask);
});

async function snap(photo, hints) {
  say("Finding edges", true);
  const fresh = segmenter.photo !== photo;
  segmenter.photo = photo;
  const sent = fresh ? { rgb: photo.rgb, width: photo.width, height: photo.height } : null;
  const { mask } = await segmenter.ask({ photo: sent, hints });
  return mask;
}

// --- points ------------------------------------------------------------------------------------

let timer = 0;
function maskChanged() {
  $("undo").disabled = !editor.history.length;
  clearTimeout(timer);
  timer = setTimeout(predict, PAUSE);
}

const predict = guarded(async () => {
  const { photo, mask } = editor, request = ++state.request, begin = performance.now();
  settle();
  if (!mask.includes(1)) {
    forgetClouds();
    throw new PhotoError("The mask is empty: paint the object first.");
  }
  say("Predicting", true);
  const about = await ready;
  if (!about) throw state.broken;
  const view = place(photo, mask, about), inputs = networkInputs(view, about);
  const count = about.random_size ? Math.min(SAMPLES, about.latents.length) : 1;
  const { points } = await network.ask({ inputs, first: 0, count });
  if (request !== state.request) return;
  const length = points.length / count, { points: normal } = view.placed ? normalForm(points) : { points };
  state.clouds = Array.from({ length: count }, (_, k) => ({
    points: normal.slice(k * length, (k + 1) * length),
    colours: coloursFromView(points.slice(k * length, (k + 1) * length), view, about),
  }));
  state.view = view;
  state.sample = Math.min(state.sample, count - 1);
  showCloud();
  const seconds = ((performance.now() - begin) / 1000).toFixed(1);
  const how = state.how ? `Object found ${state.how}. ` : "";
  state.how = "";
  say(`${how}${about.num_points.toLocaleString("en")} points in ${seconds} s.`);
});

function showCloud() {
  const cloud = state.clouds[state.sample];
  cloud.shown ??= withNeighboursColours(cloud);
  viewer.show({ points: cloud.points, colours: cloud.shown });
  document.body.classList.add("has-cloud");
  for (const button of document.querySelectorAll("[data-format], #picture")) button.disabled = false;
  $("sampling").hidden = state.clouds.length < 2;
  $("sample").max = state.clouds.length - 1;
  $("sample").value = state.sample;
  $("which").textContent = `${state.sample + 1} of ${state.clouds.length}`;
  $("size").textContent = `Proportions: ${extent(cloud.points)}. Points that the photo does not show have their neighbours' colours here and are grey in the files.`;
}

/** Colours for the viewer: a point that the photo does not show gets the colour of the nearest visible point, blended with 20 % of grey. */
function withNeighboursColours({ points, colours }) {
  const shown = colours.slice(), seen = [];
  const grey = i => colours[i] === 150 && colours[i + 1] === 150 && colours[i + 2] === 150;
  for (let i = 0; i < points.length; i += 3) if (!grey(i)) seen.push(i);
  for (let i = 0; i < points.length && seen.length; i += 3) {
    if (!grey(i)) continue;
    let best = 0, least = Infinity;
    for (const j of seen) {
      const far = (points[i] - points[j]) ** 2 + (points[i + 1] - points[j + 1]) ** 2 + (points[i + 2] - points[j + 2]) ** 2;
      if (far < least) { least = far; best = j; }
    }
    for (let c = 0; c < 3; c++) shown[i + c] = 0.8 * colours[best + c] + 0.2 * 150;
  }
  return shown;
}

function extent(points) {
  const low = [Infinity, Infinity, Infinity], high = low.map(v => -v);
  points.forEach((v, i) => { low[i % 3] = Math.min(low[i % 3], v); high[i % 3] = Math.max(high[i % 3], v); });
  const [deep, wide, tall] = high.map((v, k) => v - low[k]), unit = Math.max(deep, wide, tall) || 1;
  const part = v => (v / unit).toFixed(2);
  return `width ${part(wide)}, depth ${part(deep)}, height ${part(tall)} of the longest side`;
}

function forgetClouds() {
  state.request++;
  state.clouds = [];
  viewer.show(null);
  document.body.classList.remove("has-cloud");
  $("size").textContent = "";
  $("sampling").hidden = true;
  for (const button of document.querySelectorAll("[data-format], #picture")) button.disabled = true;
}

// --- files out ---------------------------------------------------------------------------------

function save(content, type, suffix) {
  const link = document.createElement("a"), url = URL.createObjectURL(new Blob([content], { type }));
  const numbered = state.clouds.length > 1 ? `${state.name}_${state.sample}` : state.name;
  link.href = url;
  link.download = `${numbered}.${suffix}`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
}

for (const button of document.querySelectorAll("[data-format]")) {
  button.addEventListener("click", () => {
    const [write, type] = FORMATS[button.dataset.format], { points, colours } = state.clouds[state.sample];
    save(write(points, colours), type, button.dataset.format);
  });
}
$("picture").addEventListener("click", () => $("cloud").toBlob(blob => save(blob, "image/png", "png")));

// --- files in ----------------------------------------------------------------------------------

const take = files => {
  if (files?.length) openPhoto(files[0]);
};
for (const input of document.querySelectorAll("input[type=file]")) {
  input.addEventListener("change", () => { take([...input.files]); input.value = ""; });
}
let depth = 0;
const dragging = on => document.body.classList.toggle("dragging", on);
addEventListener("dragenter", event => { event.preventDefault(); depth++; dragging(true); });
addEventListener("dragover", event => event.preventDefault());
addEventListener("dragleave", () => { depth = Math.max(0, depth - 1); if (!depth) dragging(false); });
addEventListener("drop", event => {
  event.preventDefault();
  depth = 0;
  dragging(false);
  if (event.dataTransfer.files.length) take(event.dataTransfer.files);
  else complain(new PhotoError("What you dropped is not a file; save the picture first, then drop the file."));
});
addEventListener("paste", event => take(event.clipboardData?.files));
for (const button of document.querySelectorAll("[data-example]")) {
  button.addEventListener("click", guarded(async () => {
    const response = await fetch(button.dataset.example), blob = await response.blob();
    await openPhoto(new File([blob], button.dataset.example.split("/").pop()));
  }));
}

// --- controls ----------------------------------------------------------------------------------

for (const input of document.querySelectorAll("input[name=tool]")) {
  input.addEventListener("change", () => {
    editor.tool = input.value;
    $("size-name").textContent = input.value === "fill" ? "Tolerance" : "Size";
  });
}
for (const input of document.querySelectorAll("input[name=mode]")) {
  input.addEventListener("change", () => { editor.adding = input.value === "add"; });
}
$("brush").addEventListener("input", event => { editor.size = +event.target.value; });
$("undo").addEventListener("click", () => editor.undo());
$("invert").addEventListener("click", () => editor.invert());
$("clear").addEventListener("click", () => editor.clear());
$("find").addEventListener("click", () => { settle(); findObject(); });
$("sample").addEventListener("input", event => { state.sample = +event.target.value; showCloud(); });
for (const input of document.querySelectorAll("input[name=colouring]")) {
  input.addEventListener("change", () => { viewer.colouring = input.value; viewer.redraw(); });
}
$("reset").addEventListener("click", () => viewer.reset());
$("turning").addEventListener("change", event => viewer.setTurning(event.target.checked));
viewer.onturning = on => { $("turning").checked = on; };
addEventListener("keydown", event => {
  if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z" || !editor.photo) return;
  event.preventDefault();
  editor.undo();
});

// --- start -------------------------------------------------------------------------------------

const ready = network.answer("loaded").then(({ about }) => {
  state.about = about;
  describe(about);
  return about;
}).catch(error => {
  state.broken = error;
  complain(error);
  return null;
});

function describe(about) {
  const [height, width] = about.image_size;
  $("about-network").textContent = `Network "${about.name}": ${width} x ${height} pixels to ${about.num_points.toLocaleString("en")} points${about.random_size ? `, ${Math.min(SAMPLES, about.latents.length)} guesses per photo` : ""}.`;
  const list = $("licences");
  for (const row of about.sources ?? []) {
    const item = document.createElement("li");
    const licences = Object.entries(row.licences ?? {}).map(([name, each]) => `${name}${each.holders?.length ? ` (${each.holders.join(", ")})` : ""}`);
    item.textContent = `${row.source}: ${licences.join("; ") || "not stated"}`;
    list.append(item);
  }
  $("data-and-licences").hidden = !list.children.length;
}

$("correct").open = !matchMedia("(max-width: 820px)").matches;
viewer.setTurning(!matchMedia("(prefers-reduced-motion: reduce)").matches);
document.body.classList.remove("loading");
window.psgn = { state, editor, viewer, ready, openPhoto }; // for the console
