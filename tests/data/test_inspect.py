import errno

import numpy as np
from PIL import Image

from psgn_jax.commands import inspect_records as inspect
from psgn_jax.data.dataset import RecordReader, write_dataset


def test_report_and_sheet(dataset, tmp_path, capsys):
    sheet = tmp_path / "sheet.png"
    assert inspect.main([str(dataset), "--sheet", str(sheet), "--samples", "4"]) == 0
    out = capsys.readouterr().out
    assert "split train: 37 samples in 4 shards" in out
    assert "split validation: 11 samples" in out
    picture = np.asarray(Image.open(sheet))
    assert picture.shape == (2 * (48 + 16) + 12, 2 * (3 * 64 + 12) + 12, 3)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 100


def test_a_folder_that_cannot_be_written_can_be_checked(copied, capsys, monkeypatch):
    def refuse(*_, **__):
        raise OSError(errno.EROFS, "Read-only file system", ".sheet.png.1a2b.tmp")

    monkeypatch.setattr(inspect.spheres, "write_picture", refuse)
    assert inspect.main([str(copied), "--samples", "1"]) == 0
    assert f"{copied}: Read-only file system; give --sheet\n" in capsys.readouterr().err
    assert inspect.main([str(copied), "--samples", "1", "--sheet", "x.png"]) == 2


def test_samples_off_their_masks_are_flagged_and_odd_sizes_fit(make, rng, tmp_path, capsys):
    odd = []
    for size in ((4096, 8), (8, 4096)):
        fields = {"image": np.zeros((*size, 3), np.uint8), "mask": np.ones(size, bool)}
        odd.append(make.sample(rng, **fields, depth=None, model_id=f"{size}"))
    write_dataset(tmp_path, {"train": odd}, source="test")
    assert inspect.main([str(tmp_path)]) == 1
    out = capsys.readouterr().out
    assert "flagged: record 0 ((4096, 8) view 3)" in out
    assert "DOUBTFUL 2 of 2" in out
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert sheet.height < 600


def test_damage_is_reported_and_the_rest_goes_on(make, copied, capsys):
    make.damage(copied / "train-00000.arrayrecord", RecordReader(copied, "train").read(2))
    (copied / "validation-00000.arrayrecord").unlink()
    assert inspect.main([str(copied), "--samples", "1"]) == 1
    out = capsys.readouterr().out
    assert "DAMAGED record 2 of" in out
    assert "36 samples checked" in out
    assert "is missing" in out
    assert (copied / "sheet.png").is_file()  # of the split that is whole
    (copied / "train-00001.arrayrecord").unlink()
    assert inspect.main([str(copied), "--check", "1"]) == 1
    assert "no contact sheet: " in capsys.readouterr().err
