"""Images of heights: refuses those that cannot be ground, and reads how bright their pixels are."""

import io
import warnings
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import UNREADABLE, content_of, why_unread

if TYPE_CHECKING:
    from PIL import Image

MOST_PIXELS = 25_000_000  # of an image, however small it was packed
FORMATS = (".png", ".jpg", ".jpeg", ".tif", ".tiff")  # that folders of runs may keep; who names one anew gives a PNG
_OPAQUE = 255


@lru_cache(maxsize=16)
def check_image(file: Path, changed: int) -> None:
    """Refuse what is no PNG image of one frame, all of it opaque: which other pixels are ground, nobody would know.

    Args:
        file: of the image.
        changed: when it was last changed, as one that changes is looked at again [ns].

    Raises:
        ValueError: says what it is instead.
    """
    from PIL import Image, UnidentifiedImageError

    told = f"terrain: {str(file)!r}"
    try:
        content = content_of(file)
        _check_pixels(content)
        with Image.open(io.BytesIO(content)) as image:
            is_png, frames = image.format == "PNG", getattr(image, "n_frames", 1)
            clear = _clear_pixels(image) if is_png and frames == 1 else 0
    except UnidentifiedImageError:
        raise ValueError(f"{told} is no PNG image") from None
    except UNREADABLE as failed:
        why = why_unread(failed) if isinstance(failed, OSError) else failed
        raise ValueError(f"{told} cannot be read as heights: {why}") from None
    if not is_png:
        raise ValueError(f"{told} is no PNG image; give one, as other formats change the heights they keep")
    if frames > 1:
        raise ValueError(f"{told} has {frames} frames; give a PNG image of one")
    if clear:
        raise ValueError(f"{told} has {clear} pixels that are not opaque, of no known height; give an image without")


def brightness_of(content: bytes, suffix: str) -> Floats:
    """How bright the pixels of an image are, from 0 to 1; rows along x.

    Args:
        content: of the file.
        suffix: of its name, which tells the format.

    Raises:
        UNREADABLE: one of these for a damaged image, and one of too many pixels.
    """
    _check_pixels(content)
    raw = _raw_pixels(content, suffix)
    most = np.iinfo(raw.dtype).max if np.issubdtype(raw.dtype, np.integer) else 1
    table: Floats = raw / most
    if table.ndim == 3:  # grey, or colours and maybe how opaque they are
        table = table[..., :3].mean(axis=2) if table.shape[2] >= 3 else table[..., 0]
    return table[::-1].T  # upwards is along y, to the right along x


def _raw_pixels(content: bytes, suffix: str) -> NDArray[Any]:
    from matplotlib.image import imread
    from PIL import Image

    with Image.open(io.BytesIO(content)) as image:
        if image.format == "PNG" and image.mode == "L":  # Matplotlib takes 2 and 4 bits for narrower than they come
            return np.divide(np.asarray(image), 255, dtype=np.float32)
    return np.asarray(imread(io.BytesIO(content), format=suffix[1:].lower() or None))


def _clear_pixels(image: "Image.Image") -> int:
    """Number of pixels that are not opaque."""
    if not image.has_transparency_data:
        return 0
    clear = image.info.get("transparency")
    if isinstance(clear, int) and image.mode not in ("P", "PA"):  # one grey, which may have 16 bits
        return int((np.asarray(image).astype(int) == clear).sum())
    return int((np.asarray(image.convert("RGBA"))[..., 3] < _OPAQUE).sum())


def _check_pixels(content: bytes) -> None:
    """Raise a ValueError for an image that would take gigabytes when it is unpacked."""
    from PIL import Image

    with warnings.catch_warnings():
        warnings.simplefilter("error", Image.DecompressionBombWarning)
        try:
            with Image.open(io.BytesIO(content)) as image:
                pixels = image.width * image.height
        except (Image.DecompressionBombWarning, Image.DecompressionBombError) as failed:
            raise ValueError(f"its pixels are not allowed, give at most {MOST_PIXELS}: {failed}") from None
    if pixels > MOST_PIXELS:
        raise ValueError(f"{pixels} pixels are not allowed, give at most {MOST_PIXELS}")
