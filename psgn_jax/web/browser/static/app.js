// The page: a photo, its mask, the network, its points.

import * as ort from "./runtime/ort.wasm.min.mjs";
import { CloudView, pathThrough, ramp, save } from "./cloud.js";
import { ranked, spread, sum } from "./draws.js";
import { FORMATS } from "./files.js";
import { coloursFromView, meanWithMirror, mirrored, normalForm, opaqueIn, PhotoError, place, sameProportions, findOutliers, visibleIn } from "./framing.js";
import { findMask, MIN_SIDE, objectIn } from "./mask.js";
import { fit } from "./silhouette.js";

const CLICK = 0.02, SAMPLES = 8, PAUSE = 120, HISTORY = 10, VEIL = "rgba(18, 24, 40, .68)", EDGE = "#ffb020";
const RUNTIME = "runtime/ort-wasm-simd-threaded.wasm.gz", MAX_BYTES = 80e6, MAX_SIDE = 1600;
const $ = id => document.getElementById(id);
const each = (selector, act) => document.querySelectorAll(selector).forEach(act);
const make = (tag, fields) => Object.assign(document.createElement(tag), fields);

/** The context of a new canvas, and the pixels of a context. */
const contextOf = (width, height) => make("canvas", { width, height }).getContext("2d", { willReadFrequently: true });
const pixelsOf = context => context.getImageData(0, 0, context.canvas.width, context.canvas.height).data;

/** photo: { rgb, width, height, bitmap }; maskSession: of the mask network, once a photo needs it; mask: the context of a canvas that is opaque on the object; doubt: what to say of that mask until it is changed; clouds: one for each guess; draws: what they were chosen from, in the network's unit, `scale` of theirs; turns: how many files of each kind were chosen. */
const page = { photo: null, mask: null, doubt: "", history: [], clouds: [], name: "", turns: { photo: 0, mask: 0 } };
const viewer = new CloudView([$("cloud")], $("turning"));

function say(text) {
  $("status").textContent = text;
  $("problem").hidden = true;
}

/** Runs a step; an error is shown, and the page stays usable. */
const guarded = step => async (...values) => {
  try {
    return await step(...values);
  } catch (error) {
    if (!(error instanceof PhotoError)) console.error(error);
    say("");
    $("problem").textContent = error.message || "Something went wrong.";
    $("problem").hidden = false;
  }
};

// --- photo and mask files ------------------------------------------------------------------------
/** Decodes an image, turned upright and reduced to MAX_SIDE: { bitmap, width, height, rgba }. It never ends if another of its kind is chosen meanwhile. */
function decode(file, kind) {
  const turn = ++page.turns[kind];
  return decoded(file, kind).finally(() => turn === page.turns[kind] || new Promise(() => {}));
}

async function decoded(file, kind) {
  if (file.size > MAX_BYTES) throw new PhotoError(`This file has ${Math.round(file.size / 1e6)} MB; up to ${MAX_BYTES / 1e6} MB can be read.`);
  const whole = await createImageBitmap(file, { imageOrientation: "from-image" }).catch(() => {
    throw new PhotoError(`${file.name} is not an image that this browser can read; expected JPEG, PNG or WebP.`);
  });
  const sides = [whole.width, whole.height], scale = Math.min(1, MAX_SIDE / Math.max(...sides));
  if (Math.min(...sides) < MIN_SIDE) throw new PhotoError(`This image has ${sides.join(" x ")} pixels; at least ${MIN_SIDE} per side are needed.`);
  const [width, height] = sides.map(side => Math.max(MIN_SIDE, Math.round(side * scale)));
  const bitmap = await createImageBitmap(whole, { resizeWidth: width, resizeHeight: height, resizeQuality: kind === "mask" ? "pixelated" : "high" }); // labels have no averages
  const context = contextOf(width, height);
  context.drawImage(bitmap, 0, 0);
  return { bitmap, width, height, rgba: pixelsOf(context) };
}

const withoutAlpha = rgba => new Uint8Array(3 * rgba.length / 4).map((_, i) => rgba[4 * Math.floor(i / 3) + i % 3]);

/** Opens a photo (a file or an <img>), and its mask if there is a second file, called NAME_mask. */
const open = guarded(async files => {
  const masked = files.length > 1 ? files.findIndex(file => /_mask\.\w+$/.test(file.name)) : -1;
  if (files.length > (masked < 0 ? 1 : 2)) throw new PhotoError("Open one photo at a time; a second file must be its mask, called NAME_mask.");
  const [file] = files.filter((_, i) => i !== masked);
  if (!file) throw new PhotoError("What you dropped is not a file; save the picture first, then drop the file.");
  say("Reading the photo");
  const { bitmap, width, height, rgba } = await decode(file, "photo");
  const name = file.name.replace(/\.[^.]*$/, "").replace(/[^\w-]+/g, "_"), rgb = withoutAlpha(rgba);
  Object.assign(page, { name, photo: { bitmap, width, height, rgb }, mask: contextOf(width, height), history: [], doubt: "" });
  path = [];
  Object.assign($("photo"), { width, height }).style.setProperty("--ratio", width / height);
  document.body.classList.add("has-photo");
  clearTimeout(timer);
  removeClouds();
  draw();
  const opaque = visibleIn(rgba), share = sum(opaque) / opaque.length;
  if (masked >= 0) await openMask(files[masked]);
  else if (share > 0.0005 && share < 0.97) setMask(opaque);
  else {
    const { photo } = page, found = await lookFor(photo);
    if (page.photo !== photo || page.history.length) return; // another photo was opened, or a mask given
    page.doubt = found.doubt;
    setMask(found.mask);
  }
});

const openMask = guarded(async file => {
  if (!file) return;
  const { photo } = page, { width, height } = photo, { rgba, ...read } = await decode(file, "mask");
  if (page.photo !== photo) return; // another photo was opened
  if (!sameProportions(read.width, read.height, width, height)) {
    throw new PhotoError(`The mask has ${read.width} x ${read.height} pixels; expected the photo's ${width} x ${height} or the same proportions.`);
  }
  const found = objectIn(rgba, read.width, read.height);
  remember();
  page.doubt = found.doubt;
  setMask(found.mask, read.width);
});

/** The mask that the mask network finds, with a box or a point if the visitor gave one, and its doubt. */
async function lookFor(photo, hint) {
  say(loading);
  const { about: { mask_network: about }, maskBytes } = await network;
  say("Looking for the object");
  page.maskSession ??= await startSession(maskBytes);
  const run = async pixels => {
    const { inputNames: [input], outputNames: [output] } = page.maskSession, shape = [1, 3, about.side, about.side];
    return (await page.maskSession.run({ [input]: new ort.Tensor("float32", pixels.slice(), shape) }, [output]))[output].data;
  };
  const { mask, certainty } = await findMask(photo, about, run, hint);
  const { width, height } = photo, least = about.border * Math.max(width, height);
  const near = mask.some((on, i) => on && Math.min(i % width, width - 1 - i % width, Math.floor(i / width), height - 1 - Math.floor(i / width)) <= least);
  const unsure = certainty < about.doubtful_below, why = unsure ? `it is ${Math.floor(100 * certainty)} % certain` : "it nearly touches the border";
  const doubt = ` The mask may be wrong (${why}): draw a frame around the object or click on it with the tool Find, or correct the mask.`;
  return { mask, doubt: unsure || near && !hint ? doubt : "" };
}

/** Looks again, in a frame or at a point. */
const lookAgain = guarded(async hint => {
  const { photo, history } = page, found = await lookFor(photo, hint);
  if (page.photo !== photo || page.history !== history) return; // something else was done meanwhile
  if (!found.mask.includes(1)) throw new PhotoError("No object was found there: draw a frame around it, or draw its outline.");
  page.doubt = found.doubt;
  setMask(found.mask);
});

// --- the mask --------------------------------------------------------------------------------------
/** Replaces the mask by an array with 1 on the object, which is resized if its rows are longer or shorter than the photo's. */
function setMask(mask, columns = page.photo.width) {
  const image = new ImageData(columns, mask.length / columns), layer = contextOf(columns, image.height);
  const { width, height } = page.photo;
  mask.forEach((on, i) => { image.data[4 * i + 3] = on ? 255 : 0; });
  layer.putImageData(image, 0, 0);
  page.mask = contextOf(width, height);
  page.mask.drawImage(layer.canvas, 0, 0, width, height);
  changed();
}

const maskArray = () => opaqueIn(pixelsOf(page.mask));
const remember = () => Object.assign(page, { doubt: "", history: [...page.history, { mask: maskArray(), doubt: page.doubt }].slice(-HISTORY) });

function undo() {
  if (!page.history.length) return;
  const { mask, doubt } = page.history.pop();
  page.doubt = doubt;
  setMask(mask);
}

let timer = 0;
function changed() {
  draw();
  clearTimeout(timer);
  timer = setTimeout(predict, PAUSE);
}

/** Draws the photo, dark outside the mask, and the mask's edge. */
function draw(path = []) {
  const { photo: { bitmap, width, height }, mask: { canvas: mask } } = page, context = $("photo").getContext("2d");
  const layer = contextOf(width, height), reach = Math.max(1, width / 400);
  layer.drawImage(mask, 0, 0);
  for (const [x, y] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) layer.drawImage(mask, x * reach, y * reach);
  for (const [globalCompositeOperation, fillStyle] of [["source-in", EDGE], ["destination-over", VEIL]]) {
    Object.assign(layer, { globalCompositeOperation, fillStyle }).fillRect(0, 0, width, height);
  }
  layer.globalCompositeOperation = "destination-out";
  layer.drawImage(mask, 0, 0);
  context.drawImage(bitmap, 0, 0);
  context.drawImage(layer.canvas, 0, 0);
  Object.assign(context, { strokeStyle: "#fff", lineWidth: 2 * reach }).stroke(pathThrough(path));
  $("undo").disabled = !page.history.length;
}

const checked = name => document.querySelector(`input[name=${name}]:checked`).value;
let path = [], pointer = 0, removing = false; // of the stroke that is being drawn

/** The mask's context, which adds what is drawn or removes it. */
const pen = () => Object.assign(page.mask, { globalCompositeOperation: removing ? "destination-out" : "source-over" });

function extend({ clientX, clientY }) {
  const { width, height } = page.photo, box = $("photo").getBoundingClientRect();
  path.push([(clientX - box.left) / box.width * width, (clientY - box.top) / box.height * height]);
  const [x, y] = path[0], [u, v] = path.at(-1);
  if (checked("tool") === "find") return draw([[x, y], [u, y], [u, v], [x, v]]);
  if (checked("tool") === "outline") return draw(path);
  const style = { lineWidth: +$("brush").value * width / box.width, lineCap: "round", lineJoin: "round" };
  Object.assign(pen(), style).stroke(pathThrough(path.length > 1 ? path.slice(-3) : [[x, y], [x + 0.01, y]]));
  draw();
}

$("photo").addEventListener("contextmenu", event => event.preventDefault());
$("photo").addEventListener("pointerdown", event => {
  if (path.length) return;
  pointer = event.pointerId;
  $("photo").setPointerCapture(pointer);
  remember();
  removing = (checked("mode") === "remove") !== (event.button === 2);
  extend(event);
});
$("photo").addEventListener("pointermove", event => { if (path.length && event.pointerId === pointer) extend(event); });
for (const name of ["pointerup", "pointercancel"]) $("photo").addEventListener(name, event => {
  if (!path.length || event.pointerId !== pointer) return;
  const outline = checked("tool") === "outline", click = outline && path.length < 3, [start, end] = [path[0], path.at(-1)];
  if (outline) pen().fill(pathThrough(path));
  path = [];
  if (checked("tool") === "find") {
    const box = [0, 1].map(i => Math.min(start[i], end[i])).concat([0, 1].map(i => Math.max(start[i], end[i])));
    draw();
    return lookAgain(Math.max(box[2] - box[0], box[3] - box[1]) < CLICK * page.photo.width ? { point: start } : { box });
  }
  if (!click) return changed();
  page.doubt = page.history.pop()?.doubt ?? page.doubt;
  draw();
});

// --- points ----------------------------------------------------------------------------------------
async function fetched(name) {
  const response = await fetch(name);
  if (!response.ok) throw new Error(`The page is incomplete: ${name} is missing.`);
  return response;
}

let loading = "Loading"; // the last message of `download`

/** Bytes of the files; while nothing else is said, the status shows how much of all, `total` bytes, has arrived. */
function download(names, total) {
  let megabytes = 0;
  const counted = () => new TransformStream({ transform: (part, to) => {
    megabytes += part.length / 1e6;
    loading = `Loading: ${megabytes.toFixed(1)} of ${(total / 1e6).toFixed(1)} MB`;
    if (/^(Start|Load)ing/.test($("status").textContent)) say(loading);
    to.enqueue(part);
  } });
  return Promise.all(names.map(async name =>
    new Uint8Array(await new Response((await fetched(name)).body.pipeThrough(counted())).arrayBuffer())));
}

const startSession = bytes => ort.InferenceSession.create(bytes, { executionProviders: ["wasm"] }).catch(error => {
  throw new Error(`This browser cannot run the network (${String(error.message ?? error).slice(0, 120)}).`);
});

/** Everything that the page needs: the networks, the runtime and the examples. */
async function load() {
  ort.env.wasm.proxy = true; // a worker runs the networks, so that the page answers meanwhile; it takes the inputs away
  ort.env.wasm.numThreads = 1; // several threads need headers that plain file servers do not send
  ort.env.wasm.wasmPaths = new URL("runtime/", import.meta.url).href;
  const damaged = new Error("The network's file is damaged or belongs to another page; build the page again.");
  const about = await (await fetched("network.json")).json().catch(() => { throw damaged; });
  if (/^psgn_jax network (?!2$)\d+$/.test(about.format)) throw new Error("The network was made by a later version of psgn_jax; build the page again.");
  const [name, row] = Object.entries(about.files ?? {}).find(([file]) => file.endsWith(".onnx")) ?? [];
  if (about.format !== "psgn_jax network 2" || !name) throw damaged;
  const [bytes, maskBytes, runtime] = await download([name, about.mask_network.file, RUNTIME], about.download_bytes);
  if (bytes.length !== row.bytes) throw damaged;
  const packed = new Blob([runtime]).stream(); // some servers say that .gz is an encoding, so that the browser unpacks it
  const unpacked = runtime[0] === 0x1f ? packed.pipeThrough(new DecompressionStream("gzip")) : packed;
  ort.env.wasm.wasmBinary = await new Response(unpacked).arrayBuffer();
  return { about, maskBytes, session: await startSession(bytes) };
}

function removeClouds() {
  document.body.classList.remove("has-cloud");
  viewer.show([]);
  page.clouds = [];
}

const predict = guarded(async () => {
  const { photo } = page;
  say(loading);
  const { about, session } = await network, mask = maskArray(), begin = performance.now();
  if (page.photo !== photo) return; // another one was opened
  removeClouds();
  if (!mask.includes(1)) return say("Draw around the object, paint over it, or open a mask file.");
  say("Predicting");
  await new Promise(resolve => setTimeout(resolve)); // the message is drawn first
  const view = place(photo, mask, about), { rgb: image, mask: small } = view, [h, w] = about.image_size;
  const length = 3 * about.num_points;
  const run = async (rgb, inside, latents) => { // a cloud for each of the latents, if there are any
    const feeds = { image: new ort.Tensor("uint8", rgb.slice(), [1, h, w, 3]), mask: new ort.Tensor("bool", inside.slice(), [1, h, w]) };
    if (latents.length) feeds.r = new ort.Tensor("float32", Float32Array.from(latents.flat()), [1, latents.length, about.random_size]);
    const predicted = (await session.run(feeds)).points.data, count = latents.length || 1;
    if (predicted.length !== count * length || !predicted.every(Number.isFinite)) throw new Error("The network's weights are damaged.");
    return Array.from({ length: count }, (_, k) => predicted.slice(k * length, (k + 1) * length));
  };
  const all = await run(image, small, about.latents), samples = Math.min(SAMPLES, all.length);
  const draws = samples > 1 ? ranked(all, samples, about.compared_points) : all;
  const [other] = await run(mirrored(image, w, 3), mirrored(small, w, 1), about.latents.slice(0, 1)); // of r = 0, as draws[0]
  const found = [meanWithMirror(draws[0], other), ...draws.slice(1, samples)];
  const { clouds: parts, camera } = fit(found, small, view.placed, about);
  if (page.photo !== photo) return;
  const points = Float32Array.from(parts.flatMap(part => [...part])), outlier = parts.map(findOutliers);
  const { points: normal, scale = 1 } = view.placed ? normalForm(points, outlier.flat()) : { points };
  page.clouds = parts.map((part, k) => ({
    points: normal.slice(k * length, (k + 1) * length), colours: coloursFromView(part, view, { ...about, camera }), outlier: outlier[k],
  }));
  Object.assign(page, { draws, scale });
  document.body.classList.add("has-cloud");
  $("sampling").hidden = samples < 2;
  $("sample").max = samples - 1;
  show();
  if ($("certainty").checked) paint();
  const corner = mask[0] + mask[photo.width - 1] + mask.at(-photo.width) + mask.at(-1);
  const doubt = corner === 4 ? " The mask contains all four corners: it may be inverted." : page.doubt;
  say(`${about.num_points.toLocaleString("en")} points in ${((performance.now() - begin) / 1000).toFixed(1)} s.${doubt}`);
});

const sample = () => +$("sample").value;

function show() {
  $("which").textContent = `${sample() + 1} of ${page.clouds.length}`;
  viewer.show([shown($("certainty").checked)]);
}

/** The chosen cloud without its outliers, as in files; or with the colours of its certainty, once they are known. */
function shown(certainty) {
  const { points, colours, outlier, spread } = page.clouds[sample()], kept = (_, i) => !outlier[Math.floor(i / 3)];
  const painted = certainty && spread ? Uint8Array.from(points, (_, i) => ramp(COLOURS, spread[Math.floor(i / 3)] / SPREAD_TOP)[i % 3]) : colours;
  return { points: points.filter(kept), colours: painted.filter(kept) };
}

/** Dark where the network is certain, bright where its guesses differ; as in psgn_jax.viewing. */
const SPREAD_TOP = 0.3, COLOURS = [[48, 30, 110], [124, 38, 128], [200, 62, 100], [245, 130, 70], [252, 220, 140]];

/** Shows the certainty of the points, or their colours; the first time for a photo, it is computed. */
const paint = guarded(async () => {
  const { clouds, draws, scale } = page, begun = performance.now();
  if ($("certainty").checked && !clouds[0].spread) {
    say("Comparing the guesses");
    const values = await spread(draws, clouds.length, () => new Promise(resolve => setTimeout(resolve)));
    if (page.clouds !== clouds) return; // another photo or mask
    clouds.forEach((cloud, k) => { cloud.spread = values[k].map(value => value / scale); });
    say(`The guesses were compared in ${((performance.now() - begun) / 1000).toFixed(1)} s: dark points are certain.`);
  }
  show();
});

// --- controls --------------------------------------------------------------------------------------
each("input[type=file]", input => input.addEventListener("change", () => {
  const files = [...input.files];
  input.value = "";
  if (input.id === "mask-file") openMask(files[0]);
  else if (files.length) open(files);
}));
for (const [name, on] of [["dragover", true], ["dragleave", false], ["drop", false]]) addEventListener(name, event => {
  event.preventDefault();
  document.body.classList.toggle("dragging", on);
  if (name === "drop") open([...event.dataTransfer.files]);
});
addEventListener("paste", event => { if (event.clipboardData?.files.length) open([...event.clipboardData.files]); });
each("#examples img", image => image.parentElement.addEventListener("click", () => open([image])));
each("[data-format]", button => button.addEventListener("click", () => {
  const { points, colours } = shown(), suffix = page.clouds.length > 1 ? `_${sample()}` : "";
  const { format } = button.dataset;
  save(`${page.name}${suffix}.${format}`, FORMATS[format](points, colours));
}));
$("undo").addEventListener("click", undo);
$("invert").addEventListener("click", () => { remember(); setMask(maskArray().map(m => 1 - m)); });
$("clear").addEventListener("click", () => { remember(); setMask(maskArray().fill(0)); });
$("sample").addEventListener("input", show);
$("another").addEventListener("click", () => { $("sample").value = (sample() + 1) % page.clouds.length; show(); });
$("certainty").addEventListener("change", paint);
$("reset").addEventListener("click", () => viewer.reset());
addEventListener("keydown", event => {
  if ((event.ctrlKey || event.metaKey) && !event.shiftKey && event.key.toLowerCase() === "z") undo();
});

const network = load();
guarded(async () => {
  const { about } = await network, [height, width] = about.image_size;
  $("about").textContent = `Network "${about.name}": ${width} x ${height} pixels to ${about.num_points.toLocaleString("en")} points.`;
  for (const { source, licences } of about.sources) {
    const texts = Object.entries(licences).map(([name, row]) => name + (row.holders?.length ? ` (${row.holders.join(", ")})` : ""));
    $("licences").append(make("li", { textContent: `${source}: ${texts.join("; ") || "not stated"}` }));
  }
  if (/^(Start|Load)ing/.test($("status").textContent)) say(""); // a message about a file stays
})();
window.psgn = { page, viewer, network, maskArray };
