"""Who keeps a mirror: one process at a time, for one catalogue.

The catalogue has an identity, which its first mirror gives it, and which lies in the mirror as well; so nobody mixes
two catalogues at one place. A lease in the mirror names who keeps it, and is renewed; whoever finds the lease of
another machine watches it for a while, and takes it over if nobody renews it. Clocks need not agree, and no conditional
PUT is needed: if two took it over at once, one of them would find out at the next renewal, and what both had written
would be files of the same catalogue.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import secrets
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from fractal_farm.catalogue.documents import encoded_document, opened_document, read_document
from fractal_farm.catalogue.durable import make_directory, put
from fractal_farm.catalogue.layout import IDENTITY, INDEX
from fractal_farm.catalogue.mirror.store import Store
from fractal_farm.catalogue.mirror.upload import Uploader
from fractal_farm.errors import FarmError, InputError

LEASE = "lease.json"
LEASE_SECONDS = 90.0
_RENEW_SECONDS = 20.0
_LOOK_SECONDS = 3.0
_LOCK = f"{INDEX}/mirror.lock"
WRITE_TEST = "write-test"
_ANOTHER = "holds another catalogue; choose another prefix, or get that one with `farm fetch`"


class LeaseLostError(FarmError):
    """Another process keeps the mirror now."""


def check_target(url: str, root: Path) -> None:
    """Refuse a place that cannot become, or is not, the mirror of a catalogue.

    Args:
        url: s3://bucket/prefix.
        root: the catalogue; it need not exist yet.

    Raises:
        InputError: no such URL, bucket or credentials, no right to write, or something else lies there.
        StoreError: the store does not answer.
    """
    store = Store(url)
    if store.is_empty():
        store.put(WRITE_TEST, b"")
        store.delete(WRITE_TEST)
        return
    theirs = _identity(store)
    ours = read_document(root / IDENTITY)["catalogue"] if (root / IDENTITY).exists() else None
    if theirs is None or theirs != ours:
        raise InputError(f"{url}: {'holds other objects; choose an empty prefix' if theirs is None else _ANOTHER}")


@contextlib.contextmanager
def kept(root: Path, url: str, holder: str, say: Callable[[str, str], None]) -> Iterator[Uploader]:
    """Keep the mirror of a catalogue while the context lasts; nobody else does.

    Args:
        root: the catalogue.
        url: s3://bucket/prefix.
        holder: who we are, for others to read.
        say: hears why this takes a while, if it does, and what follows.

    Yields:
        What uploads; it raises `LeaseLostError` once another process has taken over.

    Raises:
        InputError: see `check_target`; or another process keeps this mirror, or another one of this catalogue.
        StoreError: the store does not answer.
        FarmError: the file system failed.
    """
    with _alone(root, url):
        store = Store(url)
        _claim(store, root)
        lease = _Lease(store, holder, root)
        lease.take(say)
        yield Uploader(root, store, lease.renew)
        with contextlib.suppress(FarmError, RuntimeError):  # silent, or the process is ending
            lease.give_back()


@contextlib.contextmanager
def _alone(root: Path, url: str) -> Iterator[None]:
    """Keep other processes of this machine from mirroring the same directory."""
    path = root / _LOCK
    make_directory(path.parent, "process")
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"{url}: another process mirrors {root} already, all of its runs; leave catalogue.mirror out here"
            ) from None
        yield
    finally:
        os.close(descriptor)


def _claim(store: Store, root: Path) -> None:
    """Make sure that the place is this catalogue's."""
    if not (root / IDENTITY).exists():
        if not store.is_empty():
            raise InputError(f"{store.url}: {_ANOTHER}")
        put(root / IDENTITY, encoded_document({"catalogue": secrets.token_hex(16)}))
    ours = read_document(root / IDENTITY)["catalogue"]
    theirs = _identity(store)
    if theirs is None:
        if not store.is_empty():
            raise InputError(f"{store.url}: holds other objects; choose an empty prefix")
        store.put(IDENTITY, (root / IDENTITY).read_bytes())
        theirs = _identity(store)
    if theirs != ours:
        raise InputError(f"{store.url}: {_ANOTHER}")


def _identity(store: Store) -> str | None:
    """Which catalogue a mirror is of."""
    content = store.get(IDENTITY)
    document = opened_document(content) if content is not None else None
    return str(document["catalogue"]) if document and "catalogue" in document else None


class _Lease:
    """The object that says who keeps a mirror."""

    def __init__(self, store: Store, holder: str, root: Path) -> None:
        self._store = store
        self._holder = f"{holder}, process {os.getpid()} on {socket.gethostname()}"
        # Only one process at a time mirrors this directory (`_alone`), so a lease of this place has no living holder.
        self._place = f"{_boot()} {socket.gethostname()} {root.resolve()}"
        self._token = secrets.token_hex(8)
        self._count = 0
        self._renewed = 0.0

    def take(self, say: Callable[[str, str], None]) -> None:
        """Take the lease, after its holder if he is dead.

        Raises:
            InputError: its holder lives.
        """
        found = self._store.get(LEASE)
        facts = _facts(found)
        if found is not None and facts.get("place") != self._place:
            holder = facts.get("holder", "another process")
            say(
                f"{self._store.url} is kept by {holder}",
                f"it is taken over if there is no sign of life for {LEASE_SECONDS:.0f} s",
            )
            deadline = time.monotonic() + LEASE_SECONDS
            while time.monotonic() < deadline:
                time.sleep(_LOOK_SECONDS)
                now = self._store.get(LEASE)
                if now is None:
                    break
                if now != found:
                    raise InputError(
                        f"{self._store.url}: kept by {_facts(now).get('holder', holder)}; one catalogue grows on one "
                        "machine at a time: end that run first, or give this one a place of its own"
                    )
        self._write()
        if _facts(self._store.get(LEASE)).get("token") != self._token:
            raise InputError(f"{self._store.url}: another process took it at the same moment; try again")

    def renew(self) -> None:
        """Renew the lease if it is time.

        Raises:
            LeaseLostError: it is another's.
        """
        if time.monotonic() - self._renewed < _RENEW_SECONDS:
            return
        facts = _facts(self._store.get(LEASE))
        if facts and facts.get("token") != self._token:
            raise LeaseLostError(f"{self._store.url}: now kept by {facts.get('holder', 'another process')}")
        self._write()

    def give_back(self) -> None:
        """Let others take it at once."""
        if _facts(self._store.get(LEASE)).get("token") == self._token:
            self._store.delete(LEASE)

    def _write(self) -> None:
        self._count += 1
        facts = {"holder": self._holder, "place": self._place, "token": self._token, "renewals": self._count}
        self._store.put(LEASE, json.dumps(facts, indent=2).encode() + b"\n")
        self._renewed = time.monotonic()


def _facts(content: bytes | None) -> dict[str, str]:
    try:
        facts = json.loads(content or b"{}")
    except ValueError:
        return {}
    return facts if isinstance(facts, dict) else {}


def _boot() -> str:
    """What tells machines apart, and a machine from itself before it was started anew."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return secrets.token_hex(8)
