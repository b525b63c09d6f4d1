import collections

import pytest
from helpers.refusals import all_refused

from data_gen.catalogues import choosing
from data_gen.catalogues.choosing import Choice, choose
from data_gen.catalogues.entry import Entry

SIZES = {"Boats/Civilian": 40, "Boats/Military": 10, "Weather": 100, "Cars": 30, "Rare": 2}


def listed():
    return [
        Entry(f"{folder}/m{k:03d}.ac", folder.split("/")[0], "train", lambda: None)
        for folder, count in SIZES.items()
        for k in range(count)
    ]


def names(entries):
    return [entry.model_id for entry in entries]


@pytest.mark.parametrize(
    ("pattern", "count"),
    [("Boats", 50), ("Boats/Military", 10), ("Military", 10), ("*Mil*", 10), ("m00[12].ac", 9),
     ("Boats/*/m00?.ac", 20), ("Rare/m000.ac", 1), ("m000", 0), ("boats", 0), ("oats", 0)],
)  # fmt: skip
def test_patterns_stand_for_categories_folders_and_names(pattern, count):
    assert sum(choosing.matches(pattern, entry) for entry in listed()) == count
    assert choosing.matches("a[1].obj", Entry("a[1].obj", "", "train", lambda: None))


def test_include_and_exclude_and_patterns_that_fit_nothing():
    choice = Choice(include=("Boats", "Rare"), exclude=("Military", "m001.*"))
    chosen = names(choose(listed(), choice))
    folders = collections.Counter(name.rpartition("/")[0] for name in chosen)
    assert folders == {"Boats/Civilian": 39, "Rare": 1}
    assert chosen == [name for name in names(listed()) if name in chosen]
    table = (
        (Choice(exclude=("Cars", "Wether")), "exclude=Wether", "'Weather'"),
        (Choice(include=("Cars", "xyz")), "include=xyz"),
        (Choice(include=("Cars",), exclude=("Cars",)), "none of the 182 models"),
    )
    all_refused(lambda choice: choose(listed(), choice), ValueError, table)


@pytest.mark.parametrize("sample", [10, 90, 1000])
def test_a_sample_is_spread_and_part_of_a_larger_one(sample):
    def chosen(count, seed=1):
        return names(choose(listed(), Choice(sample=count, seed=seed)))

    found = chosen(sample)
    assert len(set(found)) == len(found) == min(sample, 182)
    for folder, size in SIZES.items():
        here = sum(name.rpartition("/")[0] == folder for name in found)
        assert abs(here - size * len(found) / 182) <= 1.5
    assert names(choose(listed()[::-1], Choice(sample=sample, seed=1))) == found
    assert chosen(7) == found[:7]
    assert chosen(7, seed=2) != found[:7]
