// Workers as functions that return promises.

/** A worker; `ask(message)` resolves to its answer with the same id. */
export class Asked {
  constructor(file) {
    this.worker = new Worker(new URL(file, import.meta.url), { type: "module" });
    this.waiting = new Map();
    this.count = 0;
    this.worker.addEventListener("message", ({ data }) => this.settle(data.id, data));
    this.worker.addEventListener("error", event => {
      event.preventDefault();
      const message = `A part of this page could not be loaded (${file}); it has to be opened from a web server, not as a file.`;
      for (const id of [...this.waiting.keys()]) this.settle(id, { error: message });
      this.broken = message;
    });
  }

  settle(id, data) {
    const { resolve, reject } = this.waiting.get(id) ?? {};
    this.waiting.delete(id);
    if (data.error) reject?.(new Error(data.error));
    else resolve?.(data);
  }

  answer(id) {
    return new Promise((resolve, reject) => {
      if (this.broken) reject(new Error(this.broken));
      else this.waiting.set(id, { resolve, reject });
    });
  }

  ask(message) {
    const id = ++this.count, answer = this.answer(id);
    this.worker.postMessage({ ...message, id });
    return answer;
  }
}
