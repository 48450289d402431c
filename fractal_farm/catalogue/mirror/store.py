"""One prefix of an S3 bucket, through obstore: whole objects in, whole objects out.

Credentials, region and endpoint come from the usual AWS_* environment variables. An object is one PUT, whose content
the server checks against the signed SHA-256 of the request; so an object is whole, or it is not there.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Any, TypeVar

from fractal_farm.config import MIRROR_URL
from fractal_farm.errors import FarmError, InputError

if TYPE_CHECKING:
    from obstore.store import RetryConfig

_RETRY: RetryConfig = {
    "max_retries": 3,
    "retry_timeout": timedelta(seconds=10),
    "backoff": {"init_backoff": timedelta(milliseconds=100), "max_backoff": timedelta(seconds=2), "base": 2},
}
_REQUEST_TIMEOUT = "60s"
_HANDS = 8
_T = TypeVar("_T")
_KEY = re.compile(r"[0-9A-Za-z_][0-9A-Za-z_.~-]*(/[0-9A-Za-z_][0-9A-Za-z_.~-]*)*")
_KEYS = "set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"
_CLUES = (
    ("NoSuchBucket", "no such bucket; create it, or correct the URL"),
    ("latest/api/token", f"no credentials; {_KEYS}"),
    ("latest/meta-data", f"no credentials; {_KEYS}"),
    ("InvalidAccessKeyId", f"the access key is not known there; {_KEYS}"),
    ("SignatureDoesNotMatch", f"the secret key is not the right one; {_KEYS}"),
    ("403 Forbidden", "access is denied; use credentials that may list, read and write there"),
    ("401 Unauthorized", f"access is denied; {_KEYS}"),
    ("redirect", "the bucket is in another region; set AWS_REGION"),
    ("BadScheme", "the endpoint has no TLS; set AWS_ALLOW_HTTP=true if that is what you want"),
)


class StoreError(FarmError):
    """The object store did not do what it was asked to; another time it may."""


@dataclass(frozen=True)
class ObjectFacts:
    """What a listing tells of an object.

    Attributes:
        size: bytes.
        etag: without quotes; of objects that were put as ours are, mostly the MD5 of the content.
        modified: time of the last PUT, by the server's clock.
    """

    size: int
    etag: str
    modified: datetime


class Store:
    """The objects below one URL, s3://bucket/prefix."""

    def __init__(self, url: str) -> None:
        """Nothing is asked of the server yet.

        Raises:
            InputError: not such a URL, a setting in the environment that cannot be, or obstore is not installed.
        """
        self.url = url.rstrip("/")
        self._hands = ThreadPoolExecutor(_HANDS, "store")
        if not re.fullmatch(MIRROR_URL, url):
            raise InputError(f"{url}: not a place in an object store; write s3://bucket/prefix")
        try:
            from obstore.store import S3Store
        except ModuleNotFoundError:
            raise InputError(
                f"{url}: object stores need the package obstore; pip install -c constraints.txt 'fractal-farm[s3]'"
            ) from None
        bucket, _, prefix = self.url.removeprefix("s3://").partition("/")
        options: dict[str, Any] = {} if "AWS_TIMEOUT" in os.environ else {"timeout": _REQUEST_TIMEOUT}
        try:
            self._store = S3Store(bucket, prefix=prefix or None, retry_config=_RETRY, **options)
        except Exception as error:  # obstore's own, of values in the environment
            raise InputError(f"{url}: {_first_line(error)}; look at the AWS_* variables") from None

    def put(self, key: str, content: bytes) -> None:
        """Store an object; see `put_all`."""
        self.put_all({key: content})

    def put_all(self, objects: Mapping[str, bytes]) -> None:
        """Store objects at the same time, each as a whole; they replace those that were there.

        Raises:
            InputError: the bucket or the credentials will not do.
            StoreError: the store did not answer, or did not do it; some objects may be stored all the same.
        """
        self._together(self._put, objects.items())

    def get(self, key: str) -> bytes | None:
        """The content of an object, None if there is none; see `put_all` for what is raised."""
        return self.get_all([key])[0]

    def get_all(self, keys: Sequence[str]) -> list[bytes | None]:
        """The contents of objects, fetched at the same time; see `get`."""
        return self._together(self._get, [(key,) for key in keys])

    def delete(self, key: str) -> None:
        """Remove an object, if it is there; see `put_all` for what is raised."""
        import obstore

        with self._explained(f"{self.url}/{key}"):
            obstore.delete(self._store, key)

    def listing(self, folder: str | None = None) -> dict[str, ObjectFacts]:
        """The objects below a folder, or all; strange keys are left out. See `put_all` for what is raised."""
        import obstore

        found = {}
        with self._explained(self.url):
            for chunk in obstore.list(self._store, folder):
                for facts in chunk:
                    etag = (facts["e_tag"] or "").strip('"')
                    if _KEY.fullmatch(facts["path"]):
                        found[facts["path"]] = ObjectFacts(facts["size"], etag, facts["last_modified"])
        return found

    def is_empty(self) -> bool:
        """Whether nothing at all lies there; see `put_all` for what is raised."""
        import obstore

        with self._explained(self.url):
            return not any(chunk for chunk in obstore.list(self._store, chunk_size=1))

    def _put(self, key: str, content: bytes) -> None:
        import obstore

        with self._explained(f"{self.url}/{key}"):
            obstore.put(self._store, key, content, use_multipart=False)

    def _get(self, key: str) -> bytes | None:
        import obstore

        with self._explained(f"{self.url}/{key}"):
            try:
                return bytes(obstore.get(self._store, key).bytes())
            except FileNotFoundError as error:
                if "NoSuchBucket" in str(error):
                    raise
                return None

    def _together(self, work: Callable[..., _T], arguments: Iterable[Iterable[Any]]) -> list[_T]:
        """The results of some work on each of the arguments, or the first error once all have ended."""
        # Not obstore's coroutines: they may still be at work in Python when the process ends, and then abort it.
        futures = [self._hands.submit(work, *given) for given in arguments]
        wait(futures)
        return [future.result() for future in futures]

    @contextmanager
    def _explained(self, where: str) -> Iterator[None]:
        from obstore.exceptions import BaseError

        try:
            yield
        except (BaseError, OSError) as error:
            text = str(error)
            for clue, meaning in _CLUES:
                if clue in text:
                    raise InputError(f"{where}: {meaning}") from None
            endpoint = os.environ.get("AWS_ENDPOINT_URL") or os.environ.get("AWS_ENDPOINT") or "the object store"
            if "error sending request" in text:
                raise StoreError(f"{self.url}: {endpoint} does not answer") from None
            raise StoreError(f"{where}: {_first_line(error)}") from None


def _first_line(error: Exception) -> str:
    """What matters of an error of obstore: its first line, without the server's XML and the request."""
    text = str(error).strip().partition("\n")[0].partition("<?xml")[0].rstrip(": ")
    return re.sub(r"Error performing .* - ", "", text)[:300]
