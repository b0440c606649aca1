"""Fast imports of large libraries."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def without_collection() -> Iterator[None]:
    """Within this context no garbage is collected; objects that exist at its end are left out of later collections.

    Imports make many objects that stay. To visit them again and again takes a quarter of the time of a short command.
    """
    collected = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if collected:
            gc.enable()


def load_reading() -> None:
    """Import what the reading of a file and an identification both need."""
    import emsid.first_look.clock
    import emsid.io  # noqa: F401


def load_identification() -> None:
    """Import what an identification needs, with what the first call of a compiled function loads for all of them."""
    import emsid.identification  # noqa: F401
    from emsid.estimation.linear.filtering import filtered

    filtered([1.0], [1.0], [1.0])
