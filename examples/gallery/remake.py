"""Make all pictures of the gallery anew, small enough for a repository: ``python examples/gallery/remake.py``."""

from __future__ import annotations

import runpy
from pathlib import Path

from PIL import Image

HERE = Path(__file__).parent
TARGET = HERE.parents[1] / "docs" / "figures" / "gallery"
WIDTH, COLOURS = 1100, 48  # pixels, entries of the palette


def main() -> None:
    """Run every other script of this folder."""
    TARGET.mkdir(parents=True, exist_ok=True)
    for script in sorted(HERE.glob("*.py")):
        if script.name == Path(__file__).name:
            continue
        path = TARGET / f"{script.stem}.png"
        runpy.run_path(str(script))["main"](path)
        picture = Image.open(path).convert("RGB")
        if picture.width > WIDTH:
            picture = picture.resize((WIDTH, round(picture.height * WIDTH / picture.width)), Image.Resampling.LANCZOS)
        picture.quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)


if __name__ == "__main__":
    main()
