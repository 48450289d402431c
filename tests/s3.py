"""An object store on this machine: moto's server, with a bucket, for tests of the mirror."""

from __future__ import annotations

import logging
import secrets
import urllib.request


class ObjectStore:
    """The server; what it holds outlives a stop, as long as the process lives.

    Attributes:
        url: a place in its bucket.
        endpoint: where the server listens while it does.
    """

    def __init__(self, bucket: str) -> None:
        logging.getLogger("werkzeug").setLevel(logging.ERROR)
        self._bucket = bucket
        self._port = 0
        self._server = None
        self.start()
        self.endpoint = f"http://127.0.0.1:{self._port}"
        self.url = f"s3://{bucket}"
        urllib.request.urlopen(urllib.request.Request(f"{self.endpoint}/{bucket}", method="PUT")).close()

    def at(self, name: str) -> None:
        """Choose a place that nobody has used."""
        self.start()
        self.url = f"s3://{self._bucket}/tests/{name}-{secrets.token_hex(4)}"

    def start(self) -> None:
        """Listen, at the same port as before; nothing if it does."""
        from moto.server import ThreadedMotoServer

        if self._server is None:
            self._server = ThreadedMotoServer("127.0.0.1", self._port, verbose=False)
            self._server.start()
            self._port = self._server.get_host_and_port()[1]

    def stop(self) -> None:
        """Fall silent; nothing if it is."""
        if self._server is not None:
            self._server.stop()
            self._server = None

    def environment(self) -> dict[str, str]:
        """What its clients need; nobody asks a cloud's machine for credentials."""
        return {
            "AWS_ENDPOINT_URL": self.endpoint,
            "AWS_ALLOW_HTTP": "true",
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test",
            "AWS_REGION": "us-east-1",
            "AWS_METADATA_ENDPOINT": "http://127.0.0.1:9",
        }
