// GrabCut in a worker: messages { id, photo, hints } -> masks.

import { grabCut } from "./segment.js";

let photo = null;
addEventListener("message", ({ data }) => {
  try {
    photo = data.photo ?? photo; // sent once
    postMessage({ id: data.id, mask: grabCut(photo, data.hints) });
  } catch (error) {
    postMessage({ id: data.id, error: String(error.message ?? error) });
  }
});
