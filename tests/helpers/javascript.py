"""Runs functions of JavaScript modules in node."""

import json
import shutil
import subprocess

NODE = shutil.which("node")


def node(body, modules, **values):
    """Runs the body of an async function of `input` in node; returns its result.

    Args:
      body: body of the function, as text.
      modules: files of the modules, by the names that the body uses.
      **values: fields of `input`. Arrays become Float32Array if they are of floats, otherwise
        Uint8Array. Arrays in the result become flat lists.
    """

    def plain(array):
        kind = "Float32Array" if array.dtype.kind == "f" else "Uint8Array"
        return {"kind": kind, "values": array.ravel().tolist()}

    imports = "\n".join(
        f"import * as {name} from {json.dumps(path.as_uri())};" for name, path in modules.items()
    )
    code = f"""
{imports}
import fs from "node:fs";
const kinds = {{ Float32Array, Uint8Array }};
const input = JSON.parse(fs.readFileSync(0), (_, v) => v?.kind ? kinds[v.kind].from(v.values) : v);
const result = await (async () => {{ {body} }})();
process.stdout.write(JSON.stringify(result, (_, v) => ArrayBuffer.isView(v) ? Array.from(v) : v));
"""
    done = subprocess.run(
        [NODE, "--input-type=module", "-e", code],
        input=json.dumps(values, default=plain),
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
