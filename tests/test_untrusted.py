import os

import pytest

from psgn_jax.untrusted import kind_of, one_line, parse_json, read_json


def test_json_is_read_within_bounds(tmp_path):
    assert parse_json('{"a": [1, {"b": null}]}') == {"a": [1, {"b": None}]}
    assert parse_json(b'"\xc3\xa4"') == "ä"
    assert parse_json("[" * 32 + "]" * 32)
    for text in ("[" * 33 + "]" * 33, "[" * 200_000, '{"a":' * 200_000, "[NaN]", "[-Infinity]",
                 b"\xff", b"\xff\xfe", "", "1" * 10_000, "{'a': 1}"):  # fmt: skip
        with pytest.raises(ValueError, match=r"."):
            parse_json(text)
    path = tmp_path / "a.json"
    path.write_text("[1, 2]")
    assert read_json(path) == [1, 2]
    with pytest.raises(ValueError, match="6 bytes, expected at most 5"):
        read_json(path, max_bytes=5)


def test_what_is_no_file_is_called_what_it_is(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    assert kind_of(pipe) == "a named pipe"
    assert kind_of(tmp_path) == "a folder"
    assert kind_of("/dev/null") == "a device"
    with pytest.raises(OSError, match="it is a named pipe, expected a file"):
        read_json(pipe)
    with pytest.raises(FileNotFoundError):
        kind_of(tmp_path / "none")


def test_names_fit_into_one_line():
    assert one_line("bär 椅子.png") == "bär 椅子.png"
    assert one_line("a\nb\r\t\x1b[31m\u2028\x85") == r"a\nb\r\t\x1b[31m\u2028\x85"
    assert one_line(os.fsdecode(b"a\xff")) == r"a\udcff"
    one_line(os.fsdecode(b"\xff")).encode()
