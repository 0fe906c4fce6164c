"""TOML files that come with the program, beside those that users write."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources.abc import Traversable
from itertools import takewhile
from pathlib import Path

from zenoh_cbef.errors import UserError
from zenoh_cbef.words import meant


@dataclass(frozen=True)
class Library:
    """The built-in files of one kind. kind: what they are, also the verb that lists them."""

    folder: Traversable
    kind: str

    def names(self) -> list[str]:
        """The built-in ones."""
        return sorted(
            entry.name.removesuffix(".toml") for entry in self.folder.iterdir() if entry.name.endswith(".toml")
        )

    def purposes(self) -> dict[str, str]:
        """The built-in ones, each with the first sentence of the comment that it begins with."""
        return {name: purpose_of(self.read(name)[0]).partition(". ")[0].rstrip(".") for name in self.names()}

    def read(self, name: str) -> tuple[str, Path]:
        """The text of a built-in one or of a file, and the folder that its relative paths start from."""
        known = self.names()
        if name in known:
            return (self.folder / f"{name}.toml").read_text(encoding="utf-8"), Path.cwd()
        path = Path(name)
        if not path.exists():
            near = meant(name, known, f"see 'zenoh-cbef {self.kind} list', or give a file")
            raise UserError(f"there is no built-in {self.kind} and no file named {name!r}; {near}")
        if path.is_dir():
            inside = next(
                (str(one) for one in (path / f"{self.kind}.toml", *sorted(path.glob("*.toml"))) if one.is_file()), ""
            )
            hint = f"did you mean {inside!r}?" if inside else f"name the file of the {self.kind}"
            raise UserError(f"{path} is a folder; {hint}")
        try:
            return path.read_text(encoding="utf-8-sig"), path.resolve().parent
        except OSError as error:
            raise UserError(f"cannot read {path}: {error.strerror}; name a file that can be read") from None
        except UnicodeDecodeError:
            raise UserError(f"{path} is not UTF-8 text; {self.kind}s are written in TOML") from None


def purpose_of(source: str) -> str:
    """The comment that a file begins with, as one line."""
    lines = takewhile(lambda line: line.startswith("#"), source.splitlines())
    return " ".join(line.removeprefix("#").strip() for line in lines)
