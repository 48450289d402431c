"""An object store on this machine: moto's server, with a bucket, for tests of the mirror."""

from __future__ import annotations

import logging
import os
import urllib.request

from moto.server import ThreadedMotoServer


class ObjectStore:
    """The server; what it holds outlives a stop, as long as the process lives.

    Attributes:
        url: of the bucket.
        endpoint: where the server listens while it does.
    """

    def __init__(self, bucket: str) -> None:
        logging.getLogger("werkzeug").setLevel(logging.ERROR)
        self._port = 0
        self.start()
        self.url = f"s3://{bucket}"
        self.endpoint = f"http://127.0.0.1:{self._port}"
        request = urllib.request.Request(f"{self.endpoint}/{bucket}", method="PUT")
        urllib.request.urlopen(request).close()

    def start(self) -> None:
        """Listen, at the same port as before."""
        self._server = ThreadedMotoServer("127.0.0.1", self._port, verbose=False)
        self._server.start()
        self._port = self._server.get_host_and_port()[1]

    def stop(self) -> None:
        """Fall silent."""
        self._server.stop()

    def environment(self) -> dict[str, str]:
        """What its clients need; nobody ever asks a cloud for credentials."""
        return {
            "AWS_ENDPOINT_URL": self.endpoint,
            "AWS_ALLOW_HTTP": "true",
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test",
            "AWS_REGION": "us-east-1",
            "AWS_METADATA_ENDPOINT": "http://127.0.0.1:9",
        }

    def settle(self) -> None:
        """Make this process a client."""
        os.environ.update(self.environment())
