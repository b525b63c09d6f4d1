from psgn_jax.data import synsets


def test_names_are_unique():
    assert len(synsets.SHAPENET) == len(set(synsets.SHAPENET.values())) == 55


def test_the_13_categories_have_the_papers_names():
    assert list(synsets.R2N2.values()) == [
        "plane", "bench", "cabinet", "car", "chair", "monitor", "lamp", "speaker", "firearm",
        "couch", "table", "cellphone", "watercraft",
    ]  # fmt: skip
