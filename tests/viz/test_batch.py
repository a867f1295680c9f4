"""Many recordings on a real cluster: what is killed is done again, what is wrong is named, what is done stays done."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator, Sequence
from dataclasses import replace
from http.client import HTTPException
from pathlib import Path
from urllib.request import urlopen

import numpy as np
import psutil
import pyarrow
import pytest
from distributed import Client, Security, WorkerPlugin
from pyarrow.parquet import read_table

from estimator.table.contacts import STATUSES
from estimator.table.files import read_contacts
from vbaa_calib.cli.main import main
from viz.batch import cluster, work
from viz.batch.cluster import Where, client_of
from viz.batch.recordings import BatchRecording, recordings_of
from viz.batch.results import Results
from viz.batch.work import BatchSettings

from ..csv_files import read_rows
from ..recordings import write_recording, write_rig

FRAMES = 60
KEYS = ("tls_ca_file", "tls_client_cert", "tls_client_key")
DEADLY = "deadly"


class KillsItself(WorkerPlugin):
    """In every worker, also one that takes a killed one's place: opening the deadly recording ends the process."""

    def setup(self, worker: object) -> None:
        opened = work.open_source

        def deadly(path: Path, *given: object) -> object:
            if DEADLY in path.name:
                os.kill(os.getpid(), signal.SIGKILL)
            return opened(path, *given)  # type: ignore[arg-type]

        work.open_source = deadly  # type: ignore[assignment]


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    with client_of(Where(jobs=2)) as one:
        one.register_plugin(KillsItself())
        yield one


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording s0 with its rig.json; never to be written to."""
    root = tmp_path_factory.mktemp("recordings")
    write_rig(root / "rig.json")
    write_recording(root / "s0", FRAMES, 0)
    return root


def batch(
    client: Client, given: Sequence[BatchRecording], results: Results, settings: BatchSettings | None = None
) -> dict[str, work.Outcome]:
    results.prepare([])
    with results.locked():
        found = list(cluster.run(client, given, settings or BatchSettings(), results))
    assert len({each.name for each in found}) == len(found)
    results.write_summary([each.row for each in found if each.state == "failed"])
    return {each.name: each for each in found}


def summary(results: Results) -> dict[str, dict[str, str]]:
    return {row["recording"]: row for row in read_rows(results.summary)}


def same_bits(own: pyarrow.Table, other: pyarrow.Table) -> bool:
    """Row by row, NaN where NaN is."""
    columns = [(own[name].to_numpy(), other[name].to_numpy()) for name in other.column_names]
    return all(a.tolist() == b.tolist() if a.dtype == object else a.tobytes() == b.tobytes() for a, b in columns)


def test_nobody_without_its_keys_reaches_the_cluster(client: Client) -> None:
    """All that it opens is on loopback; without its keys no client comes in and no page is served."""
    own = psutil.Process()
    opened = [
        each.laddr
        for process in (own, *own.children(recursive=True))
        for each in process.net_connections("tcp")
        if each.status == psutil.CONN_LISTEN
    ]
    assert {address.ip for address in opened} == {"127.0.0.1"}
    scheduler = client.scheduler.address.partition("://")[2]
    for scheme, keys in (("tcp", Security(require_encryption=False)), ("tls", Security.temporary())):
        with pytest.raises((OSError, RuntimeError), match=r"onnect|certificate"):
            Client(f"{scheme}://{scheduler}", security=keys, timeout=2.0, set_as_default=False)
    for address in opened:
        with pytest.raises((OSError, HTTPException)):
            urlopen(f"http://127.0.0.1:{address.port}/status", timeout=2.0)


def test_a_scheduler_that_is_there(client: Client, folder: Path, tmp_path: Path) -> None:
    """With its certificates, by address or file; none without TLS unless that is asked for, before anything is made."""
    address, out = client.scheduler.address, tmp_path / "results"
    call = ["batch", str(folder / "s0"), "--rig", str(folder / "rig.json"), "-o", str(out)]
    plain, file = tmp_path / "plain.json", tmp_path / "scheduler.json"
    plain.write_text(json.dumps({"address": address.replace("tls://", "tcp://")}))
    file.write_text(json.dumps({"address": address}))
    tls = []
    for flag, name in zip(("--tls-ca-file", "--tls-cert", "--tls-key"), KEYS, strict=True):
        (tmp_path / f"{name}.pem").write_text(getattr(client.security, name))
        tls += [flag, str(tmp_path / f"{name}.pem")]
    for words in (
        ["--scheduler", address.replace("tls://", "tcp://")],
        ["--scheduler", address.partition("://")[2]],
        ["--scheduler", address.replace("tls://", "ws://")],
        ["--scheduler-file", str(plain)],
        ["--scheduler", address],  # certificates are missing
        ["--scheduler", address, *tls[:-1], str(tmp_path / "tls_ca_file.pem")],
        ["--scheduler", address, *tls[:-1], str(tmp_path / "none.pem")],
        ["--scheduler-file", str(folder / "rig.json"), *tls],
        ["--insecure-scheduler"],
        tls,
    ):
        assert main([*call, *words]) == 2, words
        assert not out.exists(), words
    assert main([*call, "--scheduler", address, *tls]) == 0
    assert list(summary(Results(out))) == ["s0"]
    assert main([*call, "--scheduler-file", str(file), *tls]) == 0


def test_what_is_wrong_is_named_and_the_rest_goes_on(
    client: Client, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A corrupt recording and one that kills its worker every time; mended, only these are done again."""
    # each time costs a new worker's imports
    monkeypatch.setattr(cluster, "POOL", replace(cluster.POOL, retries=1))
    monkeypatch.setattr(client.cluster.scheduler, "allowed_failures", 1)
    own = tmp_path / "own"
    paths = {name: write_recording(own / name, 8, seed) for seed, name in enumerate(("good", "corrupt", DEADLY))}
    lines = paths["corrupt"] / "recording" / "centrelines.csv"
    whole = lines.read_text()
    lines.write_text(whole[: len(whole) // 2] + "\n7,nonsense,3,0.1\n")
    given = recordings_of([str(own / "*")], folder / "rig.json")
    results = Results(tmp_path / "results")
    found = batch(client, given, results)
    assert (found["corrupt"].state, found[DEADLY].state) == ("failed", "failed")
    assert found["good"].state in ("done", "unchanged")  # the deadly one may end its worker, too
    rows = summary(results)
    assert "centrelines.csv" in rows["corrupt"]["sentence"]
    assert f"lost {cluster.POOL.retries + 1} times" in rows[DEADLY]["sentence"]
    assert not results.contacts("corrupt").exists()
    lines.write_text(whole)
    paths[DEADLY] = paths[DEADLY].rename(own / "mended")
    given = recordings_of([str(own / "*")], folder / "rig.json")
    again = batch(client, given, results)
    assert again["good"].state == "unchanged"
    # unchanged: a worker was lost after all was written, and the next one found it done
    assert {again[name].state for name in ("corrupt", "mended")} <= {"done", "unchanged"}
    assert [len(read_contacts(results.contacts(name))) for name in ("corrupt", "mended")] == [8, 8]
    # another option, another input: what depends on it is done again
    assert batch(client, given[:1], results, BatchSettings(no_moment=True))[given[0].name].state == "done"
    with (paths["good"] / "recording" / "recording.csv").open("a") as table:
        table.write("8,9.0,0,0,\n")
    assert batch(client, given, results)["good"].row["frames"] == 9


def test_rows_are_those_of_estimate(folder: Path, tmp_path: Path) -> None:
    """Bit for bit, for any number of threads, with drift that is learnt; the summary counts them."""
    path, rig = write_recording(tmp_path / "one", 200, 7, rolling=True), folder / "rig.json"
    one = tmp_path / "one.parquet"
    assert main(["estimate", str(path), "--rig", str(rig), "-o", str(one), "--no-report"]) == 0
    for threads in (1, 3):
        results = Results(tmp_path / f"results{threads}")
        row = work.do(BatchRecording("one", path, rig), BatchSettings(threads=threads), results).row
        assert same_bits(read_table(results.contacts("one"), partitioning=None), read_table(one))
        assert row == results.done("one")
        assert row["free_frames"] > 0
        table = read_contacts(tmp_path / "one.parquet")
        counts = {status: int((table.status == status).sum()) for status in STATUSES}
        assert {status: row[status] for status in STATUSES} == counts
        assert min(row["ok"], row["no_contact"]) > 4
        medians = [float(np.median(values[table.located])) for values in (table.distance_m, table.distance_std_m)]
        assert [row["distance_median_m"], row["distance_std_median_m"]] == medians
        assert row["readings"]["frames"] == row["frames"] == len(table)


def test_another_folder_is_not_written_into_nor_one_that_another_works_in(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "letter.txt").write_text("mine")
    call = ["batch", str(folder / "s0"), "--rig", str(folder / "rig.json"), "-o", str(tmp_path)]
    assert main(call) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["letter.txt"]
    results = Results(tmp_path / "used")
    results.prepare([])
    with results.locked():
        assert main([*call[:-1], str(results.root)]) == 2
    assert main([*call, "--jobs", "0"]) == 2
    assert main([*call[:-1], str(tmp_path / "new"), "--scheduler", "tcp://127.0.0.1:9", "--jobs", "2"]) == 2
