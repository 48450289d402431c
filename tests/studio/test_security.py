"""Whoever does not belong here is refused, the studio lives on, and the catalogue is what it was."""

import contextlib
import json
import math
import os
import socket
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest

from fractal_farm.catalogue import Catalogue
from fractal_farm.catalogue.verify import verify

SYMMETRIES = ("mirror", "rotation:2", "rotation:3")


@pytest.fixture(scope="module")
def digest(studio):
    """The digest of the catalogue before anything happens."""
    return Catalogue.open(studio.directory).digest()


@pytest.fixture(scope="module")
def genome(studio):
    identity = Catalogue.open(studio.directory).designs(["design_id"]).column(0)[0].as_py()
    return studio.get(f"api/design/{identity}").json()["genome"]


def kept(studio):
    """Names of all commits and judgements."""
    return sorted(path.name for place in ("manifest/designs", "runs") for path in (studio.directory / place).rglob("*"))


@pytest.fixture(autouse=True)
def unharmed(studio, digest):
    """After each test the studio answers, and the catalogue has what it had."""
    before = kept(studio)
    yield
    deadline = time.monotonic() + 15
    while (answer := studio.get("data/catalogue.json")).status_code != 200:
        assert time.monotonic() < deadline, answer.text
        time.sleep(0.2)
    assert kept(studio) == before
    assert studio.process.poll() is None


def raw(studio, content, seconds=15.0):
    """What a connection answers to these bytes, until it is closed or silent for a moment after an answer."""
    with socket.create_connection(("127.0.0.1", studio.port), timeout=seconds) as connection:
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            connection.sendall(content)
        found = b""
        try:
            while piece := connection.recv(1 << 16):
                found += piece
                connection.settimeout(0.5)
        except (TimeoutError, ConnectionResetError):
            pass
        return found


def status(answer):
    return int(answer.split(b" ", 2)[1]) if answer.startswith(b"HTTP/") else None


def request(studio, target, method="GET", headers="", host=None):
    host = f"127.0.0.1:{studio.port}" if host is None else host
    return f"{method} {target} HTTP/1.1\r\nHost: {host}\r\n{headers}\r\n".encode("latin-1")


@pytest.mark.parametrize("token", [None, "", "wrong", "é"])
def test_nothing_is_written_without_the_token(studio, genome, token):
    headers = {} if token is None else {"X-Farm-Token": token.encode("latin-1")}
    for path, body in (
        ("api/keep", {"genome": {**genome, "symmetry": "mirror"}}),
        ("api/judge", {"design_id": "abcd", "favourite": True}),
        ("api/breed", {"design_ids": ["abcd"]}),
        ("api/score", {"genome": genome}),
        ("api/solid", {"genome": genome}),
        ("api/views", {"name": "a", "query": "b"}),
    ):
        answer = httpx.post(studio.url + path, json=body, headers=headers)
        assert (path, answer.status_code) == (path, 403)
        assert "token" in answer.json()["error"]


def test_a_token_in_the_address_does_not_write(studio, genome):
    answer = httpx.post(f"{studio.url}api/score?token={studio.token}", json={"genome": genome})
    assert answer.status_code == 403


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1", "127.0.0.1:1", "127.0.0.1.evil.example:{port}", ""]
)
def test_names_that_are_rebound_to_this_machine_get_nothing(studio, host):
    for target in ("/", "/data/catalogue.json", "/api/presets"):
        answer = raw(studio, request(studio, target, host=host.format(port=studio.port)))
        assert status(answer) in (400, 403)
        assert b"small" not in answer
        assert b"rows" not in answer


def test_two_hosts_and_no_host_get_nothing(studio):
    two = request(studio, "/data/catalogue.json", headers="Host: evil.example\r\n")
    assert status(raw(studio, two)) in (400, 403)
    assert status(raw(studio, b"GET /data/catalogue.json HTTP/1.1\r\n\r\n")) in (400, 403)
    assert status(raw(studio, b"GET /data/catalogue.json HTTP/1.0\r\n\r\n")) in (400, 403)


@pytest.mark.parametrize(
    "target",
    [
        "/../../../../../../etc/passwd",
        "/..%2f..%2f..%2f..%2f..%2fetc/passwd",
        "/%2e%2e/%2e%2e/%2e%2e/%2e%2e/etc/passwd",
        "/%252e%252e/%252e%252e/etc/passwd",
        "/core/../../../../../../etc/passwd",
        "//etc/passwd",
        "/%2fetc%2fpasswd",
        "/..\\..\\..\\etc\\passwd",
        "/%00/etc/passwd",
        "/../application.py",
        "/static/../guard.py",
        "/core/",
        "/data/../../../../etc/passwd",
        "/data/..%2f..%2f/columns.bin",
        "/data/x/maps/../../../../etc/passwd",
        "/data/x/maps/..%2f..%2fpasswd.bin",
        "/data/x/maps/99999999999999999999999999.bin",
        "/api/design/..%2f..%2f..%2fetc%2fpasswd",
        "/api/design/%2e%2e/solids/%2e%2e/solid.json",
        "/api/jobs/..%2f..%2f/files/passwd",
        "/api/jobs/00000000000000000000000000000000/files/..%2f..%2fpasswd",
        "/file:///etc/passwd",
        "http://evil.example/../../etc/passwd",
    ],
)
def test_no_path_leads_out_of_the_pages(studio, target):
    answer = raw(studio, request(studio, target))
    assert status(answer) in (400, 404)
    assert b"root:" not in answer
    assert b"import" not in answer


def test_a_body_of_100_mb_is_refused_before_it_is_read(studio):
    head = request(studio, "/api/score", "POST", f"X-Farm-Token: {studio.token}\r\nContent-Length: {100 << 20}\r\n")
    began = time.monotonic()
    answer = raw(studio, head)  # not a byte of it was sent
    assert status(answer) == 413
    assert time.monotonic() - began < 5
    before = memory(studio)
    answer = raw(studio, head + bytes(100 << 20))
    assert status(answer) in (413, None)  # None: the connection is cut while we send
    assert memory(studio) - before < 30 << 20


def test_a_chunked_body_without_a_length_is_refused_when_it_grows_too_large(studio):
    head = request(studio, "/api/score", "POST", f"X-Farm-Token: {studio.token}\r\nTransfer-Encoding: chunked\r\n")
    chunk = b"4000\r\n" + b" " * 0x4000 + b"\r\n"
    before = memory(studio)
    answer = raw(studio, head + chunk * 800)
    assert status(answer) in (413, None)
    assert memory(studio) - before < 30 << 20
    assert status(raw(studio, head + chunk * 5)) == 413  # 80 kB


def test_a_long_head_is_refused(studio):
    answer = raw(studio, request(studio, "/" + "a" * (1 << 20)))
    assert status(answer) in (400, 414, 431, None)
    answer = raw(studio, request(studio, "/", headers=f"X-Long: {'a' * (1 << 20)}\r\n"))
    assert status(answer) in (400, 431, None)


def wrong_genomes(genome):
    rows = genome["genes"]
    yield {**genome, "genes": [[math.nan, *rows[0][1:]], *rows[1:]]}, "finite"
    yield {**genome, "genes": [[math.inf, *rows[0][1:]], *rows[1:]]}, "finite"
    yield {**genome, "genes": [[10**400, *rows[0][1:]], *rows[1:]]}, "too large"
    yield {**genome, "genes": [["1", *rows[0][1:]], *rows[1:]]}, "not a number"
    yield {**genome, "genes": [[*rows[0][:3], 1.5, *rows[0][4:]], *rows[1:]]}, "rho"
    yield {**genome, "genes": rows[:1]}, "rows"
    yield {**genome, "genes": rows * 20}, "rows"
    yield {**genome, "genes": "rm -rf"}, "genes"
    yield {"genes": rows, "nonsense": 1}, "nonsense"
    yield {**genome, "symmetry": "rotation:99"}, "symmetry"
    yield {**genome, "probabilities": [math.nan] * len(rows)}, "probabilities"
    yield {**genome, "phenotype": {"influence": math.nan}}, "influence"
    yield {**genome, "phenotype": {"family": "../../etc"}}, "family"
    yield {}, "genes"


@pytest.mark.parametrize("number", range(14))
@pytest.mark.parametrize("path", ["api/score", "api/points", "api/keep", "api/solid"])
def test_wrong_genes_are_one_line_of_400(studio, genome, path, number):
    wrong, word = list(wrong_genomes(genome))[number]
    answer = studio.post(path, content=json.dumps({"genome": wrong}))
    assert answer.status_code == 400, answer.text
    line = answer.json()["error"]
    assert word in line
    assert "\n" not in line
    assert len(line) < 500


@pytest.mark.parametrize(
    ("path", "content"),
    [
        ("api/score", b""),
        ("api/score", b"null"),
        ("api/score", b"[]"),
        ("api/score", b"\xff\xfe"),
        ("api/score", b"[" * 60_000),
        ("api/score", b'{"genome": ' + b"[" * 50_000 + b"]" * 9_000),
        ("api/score", b'{"genome": {}, "nonsense": 1}'),
        ("api/score", b'{"genome": ' + b"9" * 10_000 + b"}"),
        ("api/points", b'{"genome": {}, "count": 1e12}'),
        ("api/points", b'{"genome": {}, "count": 100000000}'),
        ("api/judge", b'{"design_id": "../../x", "favourite": true}'),
        ("api/judge", b'{"design_id": "abcd"}'),
        ("api/judge", b'{"design_id": "abcd", "rating": 6}'),
        ("api/judge", b'{"design_id": "abcd", "rating": true}'),
        ("api/breed", b'{"design_ids": []}'),
        ("api/breed", b'{"design_ids": ["--out=/tmp/x"]}'),
        ("api/breed", b'{"design_ids": ["abcd"], "epochs": 1e9}'),
        ("api/solid", b'{"design_id": "abcd", "parameters": {"resolution": 100000}}'),
        ("api/solid", b'{"design_id": "abcd", "parameters": {"size_mm": NaN}}'),
        ("api/solid", b'{"parameters": {}}'),
        ("api/views", b'{"name": "", "query": "a"}'),
        ("api/views", b'{"name": "a", "query": 5}'),
    ],
)
def test_other_nonsense_is_one_line_of_400(studio, path, content):
    answer = studio.post(path, content=content)
    assert answer.status_code == 400, answer.text
    line = answer.json()["error"]
    assert "\n" not in line
    assert len(line) < 500


def test_unknown_presets_and_materials_are_400(studio, genome):
    for wrong in ({"preset": "nonsense"}, {"material": "../silver"}, {"parameters": {"wall_mm": 29.0}}):
        assert studio.post("api/solid", {"genome": genome, **wrong}).status_code == 400


def test_other_methods_are_refused(studio):
    for method in ("PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "CONNECT"):
        assert status(raw(studio, request(studio, "/", method))) in (400, 404, 405)
    assert studio.get("api/score").status_code in (404, 405)
    assert studio.post("data/catalogue.json").status_code in (404, 405)


def test_of_1000_requests_at_once_some_are_refused_and_nobody_waits_for_ever(studio, genome):
    begin = threading.Barrier(200)

    def asks(number):
        """Five requests on connections of their own; the status of each."""
        begin.wait()
        found = []
        for step in range(5):
            other = {**genome, "genes": [[number + 0.1 * step, *genome["genes"][0][1:]], *genome["genes"][1:]]}
            body = json.dumps({"genome": other}).encode()
            head = f"X-Farm-Token: {studio.token}\r\nContent-Length: {len(body)}\r\nConnection: close\r\n"
            found.append(status(raw(studio, request(studio, "/api/score", "POST", head) + body, 60.0)))
        return found

    with ThreadPoolExecutor(200) as pool:
        answers = Counter(code for found in pool.map(asks, range(200)) for code in found)
    assert sum(answers.values()) == 1000
    assert set(answers) <= {200, 429, 503}
    assert answers[200] > 0
    assert answers[429] + answers[503] > 0


def test_1000_connections_at_once_do_not_end_it(studio):
    connections = []
    for _ in range(1000):
        try:
            connections.append(socket.create_connection(("127.0.0.1", studio.port), timeout=5))
            connections[-1].sendall(request(studio, "/data/catalogue.json"))
        except OSError:
            continue
    answers = Counter()
    for connection in connections:
        connection.settimeout(10)
        try:
            answers[status(connection.recv(64))] += 1
        except OSError:
            answers[None] += 1
        connection.close()
    assert answers[200] > 0
    assert answers[503] > 0


@pytest.mark.slow
def test_a_client_that_never_finishes_its_request_is_sent_away(studio):
    halves = [socket.create_connection(("127.0.0.1", studio.port), timeout=30) for _ in range(20)]
    for half in halves:
        half.sendall(b"GET / HTTP/1.1\r\nHost: ")
    silent = socket.create_connection(("127.0.0.1", studio.port), timeout=30)
    body = socket.create_connection(("127.0.0.1", studio.port), timeout=30)
    token = f"X-Farm-Token: {studio.token}\r\nContent-Length: 100\r\n"
    body.sendall(request(studio, "/api/score", "POST", token) + b"{")
    assert studio.get("data/catalogue.json").status_code == 200
    began = time.monotonic()
    for half in (*halves, silent):
        try:
            while half.recv(1 << 12):
                pass
        except ConnectionResetError:
            pass
        half.close()
    assert status(body.recv(1 << 12)) == 408
    body.close()
    assert time.monotonic() - began < 20


def test_answers_forbid_others_to_use_them(studio):
    for path in ("", "data/catalogue.json", "nonsense", "api/presets"):
        headers = studio.get(path).headers
        assert "default-src 'none'" in headers["content-security-policy"]
        assert "unsafe" not in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert headers["cross-origin-resource-policy"] == "same-origin"
        assert "access-control-allow-origin" not in headers


def test_pages_of_other_sites_get_nothing(studio):
    foreign = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors"}
    for path in ("data/catalogue.json", "api/presets", "app.js"):
        assert studio.get(path, headers=foreign).status_code == 403
        assert studio.get(path, headers={**foreign, "Sec-Fetch-Site": "same-origin"}).status_code == 200
    assert (
        studio.get("", headers={**foreign, "Sec-Fetch-Mode": "navigate"}).status_code == 200
    )  # a link that is followed


def test_it_listens_on_this_machine_alone(studio):
    listening = [
        line.split()[1]
        for line in Path("/proc/net/tcp").read_text().splitlines()[1:]
        if line.split()[3] == "0A" and line.split()[1].endswith(f":{studio.port:04X}")
    ]
    assert listening == [f"0100007F:{studio.port:04X}"]


@pytest.mark.slow
def test_a_worker_that_dies_costs_one_request(studio, genome):
    for pid in children(studio):
        if "fractal_farm.studio.worker" in command(pid):
            os.kill(pid, 9)
    codes = [studio.post("api/score", {"genome": {**genome, "symmetry": name}}).status_code for name in SYMMETRIES]
    assert codes[-1] == 200
    assert codes.count(200) >= len(codes) - 1


def test_the_catalogue_is_sound_in_the_end_and_has_its_digest(studio, digest):
    assert Catalogue.open(studio.directory).digest() == digest
    assert not [finding for finding in verify(studio.directory, "deep").findings if finding.damage]


def memory(studio):
    """Bytes that the studio itself occupies."""
    words = Path(f"/proc/{studio.process.pid}/status").read_text().split("VmRSS:")[1].split()
    return 1024 * int(words[0])


def children(studio):
    pid = studio.process.pid
    return [int(each) for each in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def command(pid):
    return Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")
