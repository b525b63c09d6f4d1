import dataclasses

import jax
import pytest
from helpers import standin

from psgn_jax import tasks
from psgn_jax.config import Config, ConfigError, parse
from psgn_jax.training import memory
from psgn_jax.training.state import optimizer


@pytest.fixture(autouse=True)
def source(monkeypatch):
    standin.install(monkeypatch)


def check(config, tmp_path):
    task, tx = tasks.create(config, tmp_path), optimizer(config.optim, 10)
    memory.check_memory(config, lambda: task.create(tx))


@pytest.mark.parametrize(
    ("tree", "part"),
    [
        ({"data": {"image_size": (8192, 8192)}}, "activations of train.batch_size=32"),
        ({"model": {"fc_points": 1_000_000}}, "parameters and optimiser"),
        ({"model": {"width_multiplier": 100.0}}, "parameters and optimiser"),
        ({"train": {"batch_size": 1_000_000}}, "batches of 1000000 samples"),
        ({"eval": {"batch_size": 1_000_000}}, "batches of 1000000 samples"),
        ({"data": {"num_workers": 256}}, "data.num_workers=256: 38.4 GB"),
    ],
)
def test_what_does_not_fit_is_refused_before_it_is_compiled(tree, part, tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "available", lambda: 16e9)
    compiled = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda event, *_, **__: compiled.append(event) if "backend_compile" in event else None
    )
    with pytest.raises(
        ConfigError, match="has 16 GB of memory available, and the training"
    ) as caught:
        check(parse(tree), tmp_path)
    assert part in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not compiled


@pytest.mark.parametrize("task", ["points", "volume", "views"])
def test_the_networks_fit(task, tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "available", lambda: 16e9)
    check(parse({"task": task}), tmp_path)


def test_the_parts_are_what_training_holds(tmp_path, monkeypatch):
    """Parameters, gradients, two moments of Adam, and averaged parameters if enabled."""
    limits = []
    monkeypatch.setattr(memory, "available", lambda: 0.0)
    for decay in (0.0, 0.5):
        config = standin.config(optim__ema_decay=decay)
        with pytest.raises(ConfigError) as caught:
            check(config, tmp_path)
        text = str(caught.value).partition("optimiser: ")[2]
        limits.append(float(text.partition(" GB")[0]))
    assert limits[1] / limits[0] == pytest.approx(5 / 4, rel=0.01)


def write(root, files):
    for name, text in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def test_available_is_the_least_of_machine_and_group(tmp_path):
    assert memory.available(tmp_path) == float("inf")
    write(tmp_path, {"proc/meminfo": "MemTotal: 99 kB\nMemAvailable:   2000 kB\n"})
    assert memory.available(tmp_path) == 2000 * 1024
    group = "sys/fs/cgroup/a/b/"
    write(
        tmp_path,
        {
            "proc/self/cgroup": "0::/a/b\n",
            group + "memory.max": "1000000\n",
            group + "memory.current": "700000\n",
            group + "memory.stat": "anon 1\ninactive_file 100000\nactive_file 50000\n",
        },
    )
    assert memory.available(tmp_path) == 450_000
    write(tmp_path, {group + "memory.max": "max\n"})
    assert memory.available(tmp_path) == 2000 * 1024
    write(
        tmp_path,
        {
            "sys/fs/cgroup/memory/memory.limit_in_bytes": "900\n",
            "sys/fs/cgroup/memory/memory.usage_in_bytes": "1000\n",
            "sys/fs/cgroup/memory/memory.stat": "",
        },
    )
    assert memory.available(tmp_path) == 0


def test_every_size_has_a_bound():
    """The configuration refuses a number that no machine has enough memory for."""
    flat = {
        (section.name, field.name): getattr(getattr(Config(), section.name), field.name)
        for section in dataclasses.fields(Config)
        if dataclasses.is_dataclass(getattr(Config(), section.name))
        for field in dataclasses.fields(getattr(Config(), section.name))
        if not field.metadata.get("derived")
    }
    for (section, name), value in flat.items():
        if type(value) is int:
            with pytest.raises(ConfigError, match=rf"{section}.{name}=10+: accepted: .* and <= "):
                parse({section: {name: 10**22}})
    with pytest.raises(ConfigError, match=r"seed=10+: accepted: .* and <= "):
        parse({"seed": 10**22})
