import os

import pytest
from helpers.refusals import refused

from psgn_jax.system import untrusted
from psgn_jax.system.untrusted import brief, one_line, parse_json, read_json


def test_json_is_read_within_bounds_and_names_fit_into_one_line(tmp_path):
    assert parse_json('{"a": [1, {"b": null}]}') == {"a": [1, {"b": None}]}
    assert parse_json(b'"\xc3\xa4"') == "ä"
    assert parse_json("[" * 32 + "]" * 32)
    for text in ("[" * 33 + "]" * 33, '{"a":' * 200_000, "[NaN]", b"\xff", "", "1" * 10_000):
        with pytest.raises(ValueError, match=r"."):
            parse_json(text)
    path = tmp_path / "a.json"
    path.write_text("[1, 2]")
    assert read_json(path) == [1, 2]
    os.truncate(path, untrusted.MAX_JSON_BYTES + 1)  # without blocks on the disk
    with refused(ValueError, untrusted.MAX_JSON_BYTES + 1):
        read_json(path)
    assert brief("a\n\x1b[31m" + "b" * 300) == r"a \x1b[31m" + "b" * 190
    assert one_line("bär 椅子.png") == "bär 椅子.png"
    assert one_line("a\nb\r\t\x1b[31m\u2028\x85") == r"a\nb\r\t\x1b[31m\u2028\x85"
    assert one_line(os.fsdecode(b"a\xff")) == r"a\udcff"
    assert one_line("--out=https:/a.b/c") == "--out=https://a.b/c"  # of a path
