"""Runs functions of JavaScript modules in node."""

import base64
import json
import shutil
import subprocess

import numpy as np

NODE = shutil.which("node")


def node(body, modules, **values):
    """Runs the body of an async function of `input` in node; returns its result.

    Args:
      body: body of the function, as text.
      modules: files of the modules, by the names that the body uses.
      **values: fields of `input`. Arrays of bytes and booleans become Uint8Array, arrays of floats
        Float32Array. Arrays in the result become flat lists.
    """

    def plain(value):
        if isinstance(value, np.ndarray):
            data = np.ascontiguousarray(value).astype(
                np.float32 if value.dtype.kind == "f" else np.uint8
            )
            kind = "Float32Array" if value.dtype.kind == "f" else "Uint8Array"
            return {"kind": kind, "base64": base64.b64encode(data.tobytes()).decode()}
        if isinstance(value, list | tuple):
            return [plain(v) for v in value]
        return {k: plain(v) for k, v in value.items()} if isinstance(value, dict) else value

    imports = "\n".join(
        f"import * as {name} from {json.dumps(path.as_uri())};" for name, path in modules.items()
    )
    code = f"""
{imports}
import fs from "node:fs";
const input = JSON.parse(fs.readFileSync(0), (_, v) => {{
  if (!v || !v.kind) return v;
  const bytes = Buffer.from(v.base64, "base64");
  const copy = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length);
  return v.kind === "Float32Array" ? new Float32Array(copy) : new Uint8Array(copy);
}});
const result = await (async () => {{ {body} }})();
process.stdout.write(JSON.stringify(result, (_, v) => ArrayBuffer.isView(v) ? Array.from(v) : v));
"""
    done = subprocess.run(
        [NODE, "--input-type=module", "-e", code],
        input=json.dumps(plain(values)),
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
