import numpy as np
import pytest

from data_gen.mesh import UnusableModelError
from data_gen.readers.load import load_model


@pytest.mark.parametrize("kind", [".stl", ".ply", ".off", ".glb", ".gltf", ".obj", ".xyzzy", ""])
def test_nonsense_is_refused(write, kind):
    for content in (b"", b"\0" * 100, b"\xff\xfe nonsense \n" * 20):
        with pytest.raises(UnusableModelError):
            load_model(write(f"a{kind}", content))


@pytest.mark.parametrize("kind", ["stl", "ply", "off", "glb", "obj"])
def test_formats_agree(trimesh, write, kind):
    data = trimesh.creation.icosphere(2).export(file_type=kind)
    model = load_model(write(f"ball.{kind}", data), up="+y", front="+z")
    assert len(model.faces) == 320
    # A ball on the ground: its top is the farthest point.
    np.testing.assert_allclose(model.vertices[:, 2].max(), 1, atol=0.02)
    np.testing.assert_allclose(model.normals, (model.corners() - [0, 0, 0.5]) * 2, atol=0.1)
