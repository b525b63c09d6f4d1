// Loads the network and runs it in a worker: messages { id, inputs, first, count } -> clouds.

import * as ort from "./runtime/ort.wasm.min.mjs";
import { sha256 } from "./sha256.js";

ort.env.wasm.numThreads = 1; // several threads need headers that plain file servers do not send
ort.env.wasm.wasmPaths = new URL("runtime/", import.meta.url).href;

const DAMAGED = "The network's file is damaged or belongs to another page; build the page again.";
let about, session;

async function fetched(name) {
  const response = await fetch(new URL(name, import.meta.url));
  if (!response.ok) throw new Error(`The page is incomplete: ${name} is missing.`);
  return response;
}

async function load() {
  const description = new Uint8Array(await (await fetched("network.json")).arrayBuffer());
  const expected = (await (await fetched("network.sha256")).text()).trim();
  if (sha256(description) !== expected) throw new Error(DAMAGED);
  about = JSON.parse(new TextDecoder().decode(description));
  const [name, row] = Object.entries(about.files ?? {}).find(([file]) => file.endsWith(".onnx")) ?? [];
  if (about.format !== "psgn_jax network 1" || !name) throw new Error(DAMAGED);
  const bytes = new Uint8Array(await (await fetched(name)).arrayBuffer());
  if (bytes.length !== row.bytes || sha256(bytes) !== row.sha256) throw new Error(DAMAGED);
  try {
    session = await ort.InferenceSession.create(bytes, { executionProviders: ["wasm"] });
  } catch (error) {
    throw new Error(`This browser cannot run the network (${String(error.message ?? error).slice(0, 120)}).`);
  }
  const [h, w] = about.image_size; // a first run, so that the first photo is fast
  await run({ image: new Uint8Array(3 * h * w), mask: new Uint8Array(h * w).fill(1) }, 0, 1);
  return about;
}

async function run(inputs, first, count) {
  const [h, w] = about.image_size;
  const feeds = {
    image: new ort.Tensor("uint8", inputs.image, [1, h, w, 3]),
    mask: new ort.Tensor("bool", inputs.mask, [1, h, w]),
  };
  if (about.random_size) {
    const latents = about.latents.slice(first, first + count).flat();
    feeds.r = new ort.Tensor("float32", Float32Array.from(latents), [1, count, about.random_size]);
  }
  const points = (await session.run(feeds)).points.data;
  const whole = points.length === 3 * count * about.num_points && points.every(Number.isFinite);
  if (!whole) throw new Error("The network's points are not usable: its weights are damaged.");
  return points;
}

const ready = load();
ready.then(
  result => postMessage({ id: "loaded", about: result }),
  error => postMessage({ id: "loaded", error: error.message }),
);
let queue = ready.catch(() => {});
addEventListener("message", ({ data: { id, inputs, first, count } }) => {
  queue = queue.then(async () => {
    try {
      await ready;
      const begin = performance.now(), points = await run(inputs, first, count);
      postMessage({ id, points, milliseconds: performance.now() - begin });
    } catch (error) {
      postMessage({ id, error: String(error.message ?? error) });
    }
  });
});
