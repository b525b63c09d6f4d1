"""Runs functions of JavaScript modules in node, and reads the data of a page."""

import base64
import json
import shutil
import subprocess

NODE = shutil.which("node")


def data_of(page):
    text = page.read_text()
    return json.loads(text.split('<script type="application/json" id="data">')[1].split("</")[0])


def node(body, modules, **values):
    """Runs the body of an async function of `input` in node; returns its result.

    Args:
      body: body of the function, as text.
      modules: files of the modules, by the names that the body uses.
      **values: fields of `input`. Arrays are of bytes or bits and become Uint8Array. Arrays in the
        result become flat lists.
    """

    def plain(array):
        return {"base64": base64.b64encode(array.tobytes()).decode()}

    imports = "\n".join(
        f"import * as {name} from {json.dumps(path.as_uri())};" for name, path in modules.items()
    )
    code = f"""
{imports}
import fs from "node:fs";
const array = (v) => Uint8Array.from(Buffer.from(v.base64, "base64"));
const input = JSON.parse(fs.readFileSync(0), (_, v) => v?.base64 === undefined ? v : array(v));
const result = await (async () => {{ {body} }})();
process.stdout.write(JSON.stringify(result, (_, v) => ArrayBuffer.isView(v) ? Array.from(v) : v));
"""
    command, text = [NODE, "--input-type=module", "-e", code], json.dumps(values, default=plain)
    done = subprocess.run(command, input=text, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
