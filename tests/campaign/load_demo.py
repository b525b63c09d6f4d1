"""Fifty users of the demo at the same time, some of them hostile; on this machine only.

Every answer must be a result or an error of one line. While other users predict, pages must be
served within `SLOW` seconds. The memory of the server must be bounded. It must print no traceback
and end with Ctrl-C.
"""

import collections
import http.client
import importlib.util
import io
import json
import pathlib
import random
import re
import signal
import threading
import time
import uuid

from helpers import processes
from PIL import Image

from campaign import frame, runs

USERS = 50
SECONDS = 300.0
SLOW = 20.0
MOST_MEMORY = 2 << 30
KINDS = ("a photo", "a photo", "a photo", "a damaged photo", "a page", "another host", "too large")


def part(rng: random.Random, deadline: float, folder: pathlib.Path) -> list[frame.Finding]:
    """The part of the campaign; see the module."""
    if importlib.util.find_spec("gradio") is None:
        return [frame.Finding("load_demo: gradio", 1, 0, ["pip install 'psgn-jax[demo]'"])]
    records, base, log = runs.make_records(folder / "records"), folder / "base", folder / "log"
    quick = runs.quick(folder)
    ended = frame.run(runs.training(records, base, train__steps=8), log, 1800, **quick)
    if ended.code:
        return [frame.Finding("a training", 1, 0, [ended.text[-2000:]])]
    temporary = folder / "tmp"
    temporary.mkdir()
    findings = {
        kind: frame.Finding(f"{USERS} users, {kind}: a result, or one line of error")
        for kind in dict.fromkeys(KINDS)
    }
    command = ["-m", "psgn_jax.demo", f"--workdir={base}", "--port=0"]
    log = folder / "demo.log"
    with frame.started(command, log, TMPDIR=str(temporary), **quick) as process:
        processes.wait_until(lambda: _port(log) or process.poll() is not None, 1800)
        if not _port(log):
            return [frame.Finding("the demo starts", 1, 0, [log.read_text()[-2000:]])]
        crowd = _Crowd(_port(log), findings)
        seconds = min(SECONDS, max(deadline - time.monotonic(), 10))
        crowd.run(rng, time.monotonic() + seconds)
        memory = _memory(process.pid)
        process.send_signal(signal.SIGINT)
        code = process.wait(300)
    server = frame.Finding(
        f"the server, {seconds:.0f} s: largest memory {memory / 1e6:.0f} MB (bound "
        f"{MOST_MEMORY / 1e6:.0f}), slowest page {crowd.slowest:.1f} s (bound {SLOW:g})"
    )
    text = log.read_text(errors="replace")
    left = [p.name for p in temporary.iterdir()]
    server.add(
        (f"a traceback: {text[-1000:]}" if "Traceback" in text else "")
        or (f"exit code {code}: {text[-500:]}" if code else "")
        or (f"left behind: {left}" if left else "")
        or ("too much memory" if memory > MOST_MEMORY else "")
        or ("a page was too slow" if crowd.slowest > SLOW else "")
    )
    return [server, *findings.values()]


def _port(log: pathlib.Path) -> int:
    found = re.search(r"^http://127.0.0.1:(\d+)/$", log.read_text(errors="replace"), re.M)
    return int(found[1]) if found else 0


def _memory(pid: int) -> int:
    status = pathlib.Path(f"/proc/{pid}/status").read_text()
    found = re.search(r"VmHWM:\s+(\d+) kB", status)
    return 1024 * int(found[1]) if found else 0


class _Crowd:
    """The users, with one thread each."""

    def __init__(self, port: int, findings: dict[str, frame.Finding]) -> None:
        self._port, self._findings = port, findings
        self._lock = threading.Lock()
        self.slowest = 0.0
        self._functions = self._predict_function()

    def run(self, rng: random.Random, end: float) -> None:
        """Runs all users until the end."""
        seeds = [rng.randrange(2**32) for _ in range(USERS)]
        threads = [threading.Thread(target=self._user, args=(seed, end)) for seed in seeds]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

    def _user(self, seed: int, end: float) -> None:
        rng = random.Random(seed)
        while time.monotonic() < end:
            kind = rng.choice(KINDS)
            try:
                wrong = self._request(kind, rng)
            except Exception as error:
                wrong = f"{type(error).__name__}: {error}"
            with self._lock:
                self._findings[kind].add(wrong)
            time.sleep(rng.uniform(0, 3))

    def _request(self, kind: str, rng: random.Random) -> str:
        if kind == "another host":
            status, _ = self._ask("GET", "/", headers={"Host": "evil.com"})
            return "" if status == 403 else f"status {status}"
        if kind == "too large":
            headers = {"Content-Length": "99000000", "Content-Type": "multipart/form-data"}
            status, _ = self._ask("POST", "/gradio_api/upload", b"", headers)
            return "" if status == 413 else f"status {status}"
        began = time.monotonic()
        status, page = self._ask("GET", "/")
        self.slowest = max(self.slowest, time.monotonic() - began)
        if status != 200 or b"psgn_jax" not in page:
            return f"the page: status {status}"
        return (
            "" if kind == "a page" else self._predict(_photo(rng, kind == "a damaged photo"), kind)
        )

    def _predict(self, photo: bytes, kind: str) -> str:
        boundary = uuid.uuid4().hex
        body = (
            f'--{boundary}\r\nContent-Disposition: form-data; name="files"; filename="a.png"\r\n'
            "Content-Type: image/png\r\n\r\n"
        ).encode() + photo + f"\r\n--{boundary}--\r\n".encode()  # fmt: skip
        headers = {"Content-Type": f"multipart/form-data; boundary={boundary}"}
        status, text = self._ask("POST", "/gradio_api/upload", body, headers)
        if status != 200:
            return f"upload: status {status} {text[:200]!r}"
        file = {"path": json.loads(text)[0], "meta": {"_type": "gradio.FileData"}}
        session = uuid.uuid4().hex
        question = {
            "data": [file, None, 1, 0, "auto", "auto"],
            "fn_index": self._functions,
            "session_hash": session,
        }
        headers = {"Content-Type": "application/json"}
        data = json.dumps(question).encode()
        status, text = self._ask("POST", "/gradio_api/queue/join", data, headers)
        if status == 503:  # the server reports that the queue is full
            return ""
        if status != 200:
            return f"join: status {status} {text[:200]!r}"
        status, text = self._ask("GET", f"/gradio_api/queue/data?session_hash={session}")
        return _judged(text.decode(), kind)

    def _ask(self, method: str, path: str, body=None, headers=None) -> tuple[int, bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", self._port, timeout=240)
        try:
            connection.request(method, path, body, headers or {})
            answer = connection.getresponse()
            return answer.status, answer.read()
        finally:
            connection.close()

    def _predict_function(self) -> int:
        _, text = self._ask("GET", "/config")
        functions = [d["id"] for d in json.loads(text)["dependencies"] if len(d["inputs"]) == 6]
        return functions[0]


def _judged(stream: str, kind: str) -> str:
    """What is wrong with the stream of messages about one prediction."""
    messages = [json.loads(x[5:]) for x in stream.splitlines() if x.startswith("data:")]
    counted = collections.Counter(message["msg"] for message in messages)
    if not counted["process_completed"]:
        return f"never completed: {dict(counted)} {stream[-300:]}"
    (done,) = (m for m in messages if m["msg"] == "process_completed")
    if not done.get("success"):
        return f"failed: {json.dumps(done)[:500]}"
    shown, _, line = done["output"]["data"]
    if kind == "a photo":
        return "" if "<iframe" in shown and "points in" in line else f"no result: {line}"
    return "" if "<iframe" not in shown and "<span" in line else f"a result: {line}"


def _photo(rng: random.Random, damaged: bool) -> bytes:
    picture = Image.new("RGB", (rng.randint(60, 900), rng.randint(60, 900)), (250, 250, 250))
    width, height = picture.size
    picture.paste((200, 60, rng.randrange(256)), (width // 4, height // 4, width // 2, height // 2))
    stream = io.BytesIO()
    picture.save(stream, "PNG")
    data = stream.getvalue()
    return data[: rng.randrange(20, 100)] if damaged else data
