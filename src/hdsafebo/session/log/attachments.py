"""Files that entries refer to by their SHA-256 (recordings, an embedding), each in two copies."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path

from hdsafebo.files.atomic import replacing
from hdsafebo.files.bounded import open_regular
from hdsafebo.files.durable import make_durable_directory
from hdsafebo.session.errors import AuditError

MAX_BYTES = 2**30


class Attachments:
    """See the module.

    Args:
        folders: where each copy lies.
    """

    def __init__(self, folders: Sequence[Path]) -> None:
        self._folders = folders

    def add(self, content: bytes) -> str:
        """Keep a content durably; its digest."""
        digest = hashlib.sha256(content).hexdigest()
        for folder in self._folders:
            if not self._good(folder / digest, digest):
                _write(folder / digest, content)
        return digest

    def content(self, sha256: str) -> bytes:
        """The content behind a digest; AuditError when it is whole in neither folder."""
        for folder in self._folders:
            found = _read(folder / sha256)
            if found is not None and hashlib.sha256(found).hexdigest() == sha256:
                return found
        raise AuditError(f"{self._folders[0] / sha256}: is missing or was changed, in both copies")

    def damage(self, digests: Iterable[str]) -> list[str]:
        """Copies that are missing or were changed, in words."""
        return [
            f"{folder / digest} is missing or was changed"
            for digest in digests
            for folder in self._folders
            if not self._good(folder / digest, digest)
        ]

    def mend(self, digests: Iterable[str]) -> list[str]:
        """Restore damaged copies from the other ones; what was wrong, in words.

        Raises:
            AuditError: a file is whole in neither folder.
        """
        found = []
        for digest in digests:
            wrong = self.damage([digest])
            if wrong:
                self.add(self.content(digest))
            found += wrong
        return found

    @staticmethod
    def _good(path: Path, sha256: str) -> bool:
        content = _read(path)
        return content is not None and hashlib.sha256(content).hexdigest() == sha256


def _read(path: Path) -> bytes | None:
    """Content of a file; None when it is missing, unreadable or larger than any attachment."""
    try:
        with open_regular(path) as file:
            content = file.read(MAX_BYTES + 1)
    except OSError:
        return None
    return content if len(content) <= MAX_BYTES else None


def _write(path: Path, content: bytes) -> None:
    make_durable_directory(path.parent)
    with replacing(path) as temporary:
        temporary.write_bytes(content)
