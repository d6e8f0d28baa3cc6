"""The viewer's server: for whoever has the token, on this host, inside the map's folder."""

from __future__ import annotations

import errno
import json
import os
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from export_inputs import HOSTILE, sign, write_run
from view_maps import write_large_map

from automap.errors import ConfigError, InputError
from automap.io import names
from automap.io.review_json import read_review
from automap.io.signs_table import write_signs
from automap.records import Sign
from pipeline.cli.root import run_command
from pipeline.view import guard
from pipeline.view.command import serving
from pipeline.view.server import ViewServer
from pipeline.view.signs import read_sign_table
from tests.slow_cases import others_slow

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_run(tmp_path_factory.mktemp("view") / "out", signs=5)
    (folder / names.REPORT).write_text("<!doctype html><script>1</script>")
    (folder.parent / "secret.txt").write_text("not for the page")
    (folder / "link.txt").symlink_to(folder.parent / "secret.txt")
    return folder


@pytest.fixture(scope="module")
def server(out: Path) -> Iterator[ViewServer]:
    with serving(out) as running:
        yield running


def ask(
    server: ViewServer,
    target: str,
    host: str | None = None,
    method: str = "GET",
    headers: dict[str, str] | None = None,
    body: bytes = b"",
) -> tuple[int, dict[str, str], bytes]:
    """One request, byte for byte as given, over a socket of its own."""
    lines = [f"{method} {target} HTTP/1.1"]
    if host != "":
        lines.append(f"Host: {host or f'127.0.0.1:{server.server_port}'}")
    lines += [f"{name}: {value}" for name, value in (headers or {}).items()]
    if body:
        lines.append(f"Content-Length: {len(body)}")
    lines += ["Connection: close", "", ""]
    with socket.create_connection(("127.0.0.1", server.server_port), timeout=20) as connection:
        connection.sendall("\r\n".join(lines).encode("latin-1") + body)
        answer = b""
        while part := connection.recv(65536):
            answer += part
    head, _, content = answer.partition(b"\r\n\r\n")
    first, *rest = head.decode("latin-1").split("\r\n")
    fields = dict(line.split(": ", 1) for line in rest)
    return int(first.split()[1]), fields, content


def get(server: ViewServer, path: str) -> tuple[int, dict[str, str], bytes]:
    return ask(server, f"/{server.token}/{path}")


def post(server: ViewServer, value: Any, **headers: str) -> tuple[int, dict[str, str], bytes]:
    fields = {"Content-Type": "application/json"} | {
        k.replace("_", "-"): v for k, v in headers.items()
    }
    body = value if isinstance(value, bytes) else json.dumps(value).encode()
    return ask(server, f"/{server.token}/api/review", None, "POST", fields, body)


PLACES = ["", "api/map", "api/signs", "api/review", "main.js", "out/report.html", "frame/0/0/front"]


@pytest.mark.parametrize("place", PLACES)
def test_without_the_token_nothing_is_answered(server: ViewServer, place: str) -> None:
    wrong = server.token[:-1] + ("A" if server.token[-1] != "A" else "B")
    targets = [f"/{place}", f"/{wrong}/{place}", f"//{place}", f"/{server.token[:-1]}/{place}"]
    if not place:
        targets = ["/", f"/?token={wrong}", "/?token=", "/?token", "/index.html", "*"]
    for target in targets:
        status, _, content = ask(server, target)
        assert status == 403, target
        assert server.token.encode() not in content
    assert ask(server, f"/{wrong}/api/review", method="POST", body=b"{}")[0] == 403


def test_with_the_token_the_page_is_there(server: ViewServer) -> None:
    status, headers, content = ask(server, f"/?token={server.token}")
    assert status == 200
    assert b"<title>AutoMap</title>" in content
    assert headers["Content-Security-Policy"].startswith("default-src 'none'; script-src 'self'")
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert "Access-Control-Allow-Origin" not in headers
    assert ask(server, f"/?token={server.token}", method="HEAD")[2] == b""


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "evil.example:{port}",
        "127.0.0.1",
        "127.0.0.1:1",
        "127.0.0.1.evil.example:{port}",
        "[::1]:{port}",
        "",
    ],
)
def test_another_host_name_is_refused(server: ViewServer, host: str) -> None:
    name = host.format(port=server.server_port)
    for target in (f"/?token={server.token}", f"/{server.token}/api/map"):
        assert ask(server, target, name)[0] == 403


def test_another_site_may_neither_ask_nor_write(server: ViewServer) -> None:
    action = {"row": 0, "kind": "accept"}
    assert post(server, action, Origin="https://evil.example")[0] == 403
    assert post(server, action, Origin="null")[0] == 403
    target = f"/{server.token}/api/map"
    assert ask(server, target, headers={"Origin": "http://evil.example"})[0] == 403
    own = f"http://127.0.0.1:{server.server_port}"
    assert ask(server, target, headers={"Origin": own})[0] == 200
    # what a form of another site can send without asking first
    assert post(server, action, Content_Type="text/plain")[0] == 415


@pytest.mark.parametrize(
    "path",
    [
        "../secret.txt",
        "../../etc/passwd",
        "%2e%2e/secret.txt",
        "..%2fsecret.txt",
        "%2e%2e%2f%2e%2e%2fetc%2fpasswd",
        "a/../../secret.txt",
        "/etc/passwd",
        "%2fetc%2fpasswd",
        "..\\secret.txt",
        "link.txt",
        "run.json%00.png",
        ".",
        "",
    ],
)
def test_no_path_leads_out_of_the_folder(server: ViewServer, path: str) -> None:
    status, _, content = get(server, f"out/{path}")
    assert status in (403, 404)
    assert b"not for the page" not in content
    assert b"root:" not in content


def test_no_path_leads_out_of_the_page(server: ViewServer) -> None:
    for path in ("../server.py", "%2e%2e/server.py", "server.py", "../../pyproject.toml", "page"):
        assert get(server, path)[0] in (403, 404)


def test_files_of_the_map_are_strangers_to_the_page(server: ViewServer) -> None:
    status, headers, _ = get(server, "out/report.html")
    assert status == 200
    assert headers["Content-Security-Policy"].startswith(
        "sandbox allow-scripts; default-src 'none'"
    )
    status, headers, content = get(server, "out/run.json")
    assert (status, headers["Content-Disposition"]) == (200, "attachment")
    assert headers["Content-Security-Policy"].startswith("sandbox")
    assert json.loads(content)["automap"]


def test_the_server_listens_on_this_machine_only(server: ViewServer) -> None:
    assert server.server_address[0] == "127.0.0.1"


@pytest.mark.parametrize(
    "path",
    [
        "api/sign/99",
        "api/sign/-1",
        "api/sign/x",
        "api/drive/7",
        "frame/0/0/front",
        "frame/9/0/x",
        "face/99",
        "face/99999999999",
        "api/nothing",
        "out/none.txt",
    ],
)
def test_what_is_not_there_is_404(server: ViewServer, path: str) -> None:
    assert get(server, path)[0] == 404


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS", "PATCH", "CONNECT"])
def test_other_methods_are_refused(server: ViewServer, method: str) -> None:
    assert ask(server, f"/{server.token}/api/review", method=method)[0] == 501


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b"{", 400),
        (b"[" * 5000, 400),
        (b"[]", 400),
        ({"row": 0}, 400),
        ({"row": 99, "kind": "accept"}, 400),
        ({"row": True, "kind": "accept"}, 400),
        ({"row": 0, "kind": "destroy"}, 400),
        ({"row": 0, "kind": "correct", "lon_deg": "x"}, 400),
        ({"row": 0, "kind": "undo", "undoes": "nobody"}, 400),
        (b'{"row": 0, "kind": "correct", "lon_deg": NaN, "lat_deg": 1}', 400),
        (b" " * 70_000, 413),
    ],
)
def test_what_is_no_decision_is_not_kept(
    server: ViewServer, out: Path, body: Any, status: int
) -> None:
    before = read_review(out / names.REVIEW)
    assert post(server, body)[0] == status
    assert read_review(out / names.REVIEW) == before


@pytest.mark.parametrize("name", [HOSTILE, "stopp", "AU:R1-1"])
def test_what_is_no_class_is_refused_in_words(server: ViewServer, out: Path, name: str) -> None:
    before = read_review(out / names.REVIEW)
    status, _, content = post(server, {"row": 0, "kind": "correct", "class_name": name})
    assert status == 400
    assert "no known class of signs" in content.decode()
    assert read_review(out / names.REVIEW) == before


@pytest.mark.slow
def test_every_class_is_offered(server: ViewServer) -> None:
    from automap.signs.classes import load_classes

    offered = json.loads(get(server, "api/map")[2])["known"]
    assert set(load_classes()) <= {c["name"] for c in offered}
    # each with a picture, and what is no class without
    assert all(get(server, f"face/{name}")[2].startswith(b"\x89PNG") for name in load_classes())
    assert get(server, "face/nothing-of-the-kind")[0] == 404
    assert "DE 206" in next(c["codes"] for c in offered if c["name"] == "regulatory--stop--g1")


def test_a_decision_is_on_disk_before_it_is_answered(tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=3)
    with serving(out) as server:
        status, _, content = post(server, {"row": 1, "kind": "correct", "class_name": "yield"})
        assert status == 200
        (kept,) = read_review(out / names.REVIEW)
        assert (kept.sign, kept.class_name, kept.seen_class) == ("s0002", "yield", "speed-limit-50")
        (verdict,) = json.loads(content)["verdicts"]
        assert (verdict["row"], verdict["status"]) == (1, "corrected")
        # unknown fields of the page do not get into the file, nor another sign's name
        post(server, {"row": 0, "kind": "accept", "sign": "s0002", "id": "mine", "extra": 1})
        assert [a.sign for a in read_review(out / names.REVIEW)] == ["s0002", "s0001"]
        state = json.loads(get(server, "api/review")[2])
        assert state["count"] == 2
        assert json.loads(get(server, "api/review?known=2")[2]) == {"count": 2}
        post(server, {"row": 0, "kind": "undo", "undoes": state["last"][""]["id"]})
        told = json.loads(get(server, "api/review?known=2")[2])
        assert [v["sign"] for v in told["verdicts"]] == ["s0002"]
        # someone else damages the file: said, and nothing is overwritten
        (out / names.REVIEW).write_text("{broken")
        assert post(server, {"row": 0, "kind": "accept"})[0] == 500
        assert (out / names.REVIEW).read_text() == "{broken"


def test_a_file_that_the_system_refuses_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    out = write_run(tmp_path / "out", signs=2)

    def refused(path: Path) -> bytes:
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE), str(path))

    with serving(out) as server:
        monkeypatch.setattr(Path, "read_bytes", refused)
        status, _, content = get(server, "out/run.json")
    assert status == 500
    assert b"run.json: Too many open files" in content
    assert "Too many open files" in caplog.text
    assert "Traceback" not in caplog.text


def test_a_renamed_sign_does_not_inherit_another_ones_review(tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=2)
    with serving(out) as server:
        post(server, {"row": 0, "kind": "reject"})
    first, second = sign(1), sign(2)
    renamed = [
        Sign(**{**vars(second), "id": "s0001"}),
        Sign(**{**vars(first), "id": "s0002"}),
    ]
    write_signs(out / names.SIGNS_RAW, renamed)
    with serving(out) as server:
        (verdict,) = json.loads(get(server, "api/review")[2])["verdicts"]
        assert (verdict["row"], verdict["status"]) == (1, "rejected")
        told = json.loads(post(server, {"row": 0, "kind": "accept"})[2])["verdicts"]
        assert {v["row"]: v["status"] for v in told} == {0: "accepted", 1: "rejected"}


def unpacked(data: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The block of bytes as the page reads it."""
    (length,) = struct.unpack("<I", data[:4])
    header = json.loads(data[4 : 4 + length])
    start = 4 + length
    return header, {
        a["name"]: np.frombuffer(data, f"<{a['type']}", a["n"], start + a["at"])
        for a in header["arrays"]
    }


def test_signs_arrive_as_they_are(server: ViewServer) -> None:
    header, arrays = unpacked(get(server, "api/signs")[2])
    assert header["ids"] == [f"s{i:04d}" for i in range(1, 6)]
    lon = arrays["x"] * 360 - 180
    lat = np.degrees(np.arctan(np.sinh((0.5 - arrays["y"]) * 2 * np.pi)))
    for k, i in enumerate(range(1, 6)):
        assert lon[k] == pytest.approx(np.degrees(sign(i).lon_rad), abs=1e-9)
        assert lat[k] == pytest.approx(np.degrees(sign(i).lat_rad), abs=1e-9)
        assert header["classes"][arrays["class"][k]] == sign(i).class_name
    assert all(a["at"] % 8 == 0 for a in header["arrays"])
    value = json.loads(get(server, "api/sign/0")[2])
    assert value["values"]["ce95_m"] == pytest.approx(2.4, abs=0.3)
    assert value["values"]["first_seen"].endswith("Z")


def test_a_large_map_is_read_by_columns(tmp_path: Path) -> None:
    out = write_large_map(tmp_path / "map", 20_000)
    with serving(out) as server:
        header, arrays = unpacked(get(server, "api/signs")[2])
        assert header["n"] == len(arrays["x"]) == 20_000
        assert len(arrays["drive_members"]) == arrays["drive_starts"][-1] == 20_000
        assert json.loads(get(server, "api/sign/19999")[2])["id"] == "s019999"


def test_every_kind_of_sign_file_gives_the_same_table(tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=4)
    raw = read_sign_table(out)
    for form in ("parquet", "geojson"):
        assert run_command(["export", str(out), "--format", form]) == 0
    (out / names.SIGNS_RAW).unlink()
    tables = [read_sign_table(out)]
    (out / names.SIGNS_TABLE).unlink()
    tables.append(read_sign_table(out))
    assert raw is not None
    for table in tables:
        assert table is not None
        assert table.ids == raw.ids
        assert [table.class_of(k) for k in range(4)] == [raw.class_of(k) for k in range(4)]
        assert [table.drives_of(k) for k in range(4)] == [["demo"]] * 4
        np.testing.assert_allclose(table.lon_deg, raw.lon_deg, atol=1e-7)
        np.testing.assert_allclose(table.facing_deg, raw.facing_deg, atol=0.06)
        np.testing.assert_allclose(table.cov_en_m2, raw.cov_en_m2, rtol=1e-5)


@pytest.mark.parametrize("words", [["nothing"], ["."]])
def test_no_map_is_one_sentence(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_command(["view", *words, "--no-browser"]) == 3
    assert capsys.readouterr().err.count("\n") == 1


def test_a_folder_of_runs_names_them(tmp_path: Path) -> None:
    write_run(tmp_path / "golf-1", signs=1)
    with pytest.raises(InputError, match="golf-1"), serving(tmp_path):
        pass


def test_a_damaged_review_stops_the_viewer_at_once(tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=1)
    (out / names.REVIEW).write_text("{")
    with pytest.raises(InputError, match=r"review\.json"), serving(out):
        pass


def test_a_taken_port_is_said(out: Path, server: ViewServer) -> None:
    with (
        pytest.raises(ConfigError, match=str(server.server_port)),
        serving(out, server.server_port),
    ):
        pass


def test_links_within_the_folder_are_followed_only_inside(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "f.txt").write_text("x")
    (tmp_path / "a" / "in").symlink_to("f.txt")
    assert guard.inside(tmp_path / "a", "in").name == "f.txt"
    with pytest.raises(guard.RefusedError):
        guard.inside(tmp_path / "a", "../a/../b")


@pytest.mark.parametrize("number", others_slow([signal.SIGINT, signal.SIGTERM]))
def test_the_command_serves_until_it_is_told_to_end(out: Path, number: signal.Signals) -> None:
    code = "from pipeline.cli import main; main()"
    child = subprocess.Popen(
        [sys.executable, "-c", code, "view", str(out), "--no-browser"],
        cwd=ROOT,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert child.stdout is not None
    url = child.stdout.readline().strip()
    assert url.startswith("http://127.0.0.1:")
    child.send_signal(number)
    _, told = child.communicate(timeout=30)
    assert (child.returncode, told) == (0, "")
