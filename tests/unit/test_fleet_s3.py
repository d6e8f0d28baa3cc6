"""A store of a fleet in an object store: moto's S3 server stands for one."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from fleet_scene import ORDER, make_drives, make_store, publish_made

from automap.errors import ConfigError
from automap.io.map_tables import TRACKS, read_tracks
from automap.io.signs_table import read_signs
from pipeline.fleet.add import add
from pipeline.fleet.merge import merge
from pipeline.fleet.places import place_at
from pipeline.fleet.retry import retry
from pipeline.fleet.status import status
from pipeline.fleet.store import ASIDE, DONE, Store
from pipeline.fleet.versions import current, current_map

URL = "s3://maps/town"


@pytest.fixture
def bucket(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """An empty bucket, whose address is in the environment."""
    moto = pytest.importorskip("moto.server", reason="moto's S3 server is not installed")
    boto3 = pytest.importorskip("boto3", reason="boto3 is not installed")
    server = moto.ThreadedMotoServer(port=0)
    server.start()
    host, port = server.get_host_and_port()
    for name, value in (
        ("AWS_ACCESS_KEY_ID", "nobody"),
        ("AWS_SECRET_ACCESS_KEY", "nothing"),
        ("AWS_DEFAULT_REGION", "us-east-1"),
        ("AWS_ENDPOINT_URL", f"http://{host}:{port}"),
        ("AWS_EC2_METADATA_DISABLED", "true"),
    ):
        monkeypatch.setenv(name, value)
    boto3.client("s3").create_bucket(Bucket="maps")
    yield
    server.stop()


def upload(folder: Path, numbers: range) -> None:
    drives = place_at("s3://maps/drives")
    for path in map(Path, make_drives(folder, numbers)):
        for file in path.iterdir():
            drives.put(file, f"{path.name}/{file.name}")


def run_all(store: Store, local: Path) -> None:
    for entry in store.entries():
        if entry.state(ORDER.key) == "waiting":
            publish_made(store.place.url, entry.digest, str(local / Path(entry.path).name), ORDER)


@pytest.mark.usefixtures("bucket")
def test_a_store_and_its_drives_in_a_bucket(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no store of a fleet"):
        Store.at(URL)
    upload(tmp_path / "drives", range(5))
    store = Store.at(URL, make=True)
    assert len(add(store, ["s3://maps/drives/*"]).new) == 5
    assert add(store, ["s3://maps/drives/*"]).known == 5
    run_all(store, tmp_path / "drives")
    scratch = tmp_path / "scratch"
    made = merge(store, scratch=scratch)
    assert (made.drives, made.version, current(store)) == (5, "000001", "000001")
    assert not merge(store, scratch=scratch).new
    # the signs are those of a store in a folder
    beside = make_store(tmp_path / "beside")
    run_all(beside, tmp_path / "beside" / "drives")
    merge(beside)
    with current_map(store) as folder, current_map(beside) as other:
        assert folder is not None
        assert other is not None
        ours, theirs = (read_signs(f / "signs_raw.parquet") for f in (folder, other))
        assert [(s.id, s.lat_rad, s.lon_rad) for s in ours] == [
            (s.id, s.lat_rad, s.lon_rad) for s in theirs
        ]
        assert list(read_tracks(folder / TRACKS)) == list(read_tracks(other / TRACKS))
        told = json.loads((folder / "merge.json").read_text())["warnings"]
        assert any("object store would have to send them all" in text for text in told)
    # a drive more, the older version stays readable
    upload(tmp_path / "more", range(5, 6))
    assert len(add(store, ["s3://maps/drives/d5"]).new) == 1
    run_all(store, tmp_path / "more")
    assert merge(store, scratch=scratch).version == "000002"
    assert store.place.names("maps") == ["000001", "000002"]
    (first, *_) = store.entries()
    store.unmark(first.digest, DONE)
    store.mark(first.digest, ASIDE, {"kind": "data", "error": "there are no fixes."})
    store.write("settings.json", {"settings": {}, "key": ORDER.key})
    told = status(store)[0]
    assert (told["done"], told["aside"], told["waiting"]) == (5, 1, 0)
    assert [entry.digest for entry in retry(store, [])] == [first.digest]
    assert status(store)[0]["waiting"] == 1
