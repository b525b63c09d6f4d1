import jax
import pytest
from jax.experimental.compilation_cache import compilation_cache

CACHE = {
    "jax_persistent_cache_min_compile_time_secs": 0,
    "jax_persistent_cache_min_entry_size_bytes": -1,
}


@pytest.fixture(scope="package", autouse=True)
def keep_compiled(tmp_path_factory):
    """Each program is compiled once for all tests of this folder."""
    before = {name: jax.config.values[name] for name in (*CACHE, "jax_compilation_cache_dir")}
    folder = str(tmp_path_factory.mktemp("compiled"))
    for name, value in {**CACHE, "jax_compilation_cache_dir": folder}.items():
        jax.config.update(name, value)
    compilation_cache.reset_cache()
    yield
    for name, value in before.items():
        jax.config.update(name, value)
    compilation_cache.reset_cache()
