"""Which program this is: results are only taken for those of another run of the same one."""
import functools
import hashlib
import pathlib

from .. import engine


@functools.lru_cache(maxsize=None)
def identity():
    """Version, and a hash of the engine's module and of what runs cases."""
    digest = hashlib.sha256(pathlib.Path(engine.__file__).read_bytes())
    for name in ('child.py', 'expressions.py', 'peers.py'):
        digest.update(pathlib.Path(__file__).with_name(name).read_bytes())
    return f'{engine.__version__} {digest.hexdigest()[:16]}'
