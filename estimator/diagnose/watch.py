"""The verdict on a recording from its frames in order: what is wrong with it, and which rows that concerns."""

from __future__ import annotations

import math
from array import array
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace

import numpy as np

from estimator.contact.contacts import Contacts
from estimator.contact.inputs import Batch, OutlierSettings, point_scatter, shared_share
from estimator.contact.settings import ContactSettings
from estimator.table.contacts import Contact, ContactTable, Measured
from estimator.table.overview import Overview
from vbaa_calib.core.arrays import spread_evenly
from vbaa_calib.core.errors import Diagnosis, Severity, Verdict
from vbaa_calib.core.robust import NORMAL_QUARTILE
from vbaa_calib.diagnose.decision import DecisionSettings, causes, explained
from vbaa_calib.rig import Rig
from vbaa_calib.session import Drift, Frame, numbers_of

from .changes import CHANGES, axes_of
from .evidence import Case, Recorded
from .hypotheses import READINGS, TABLE, unseen_joints
from .settings import RecordingSettings


@dataclass(frozen=True)
class RecordingVerdict:
    """Diagnoses of a recording, with the rows that they concern.

    Attributes
    ----------
    verdict : with the findings, the worst first.
    first : row from which on it concerns all rows; None where it concerns none but `rows`.
    rows : single rows that it concerns.
    log_odds : of the likeliest cause over all being as reported; 0 without one.
    """

    verdict: Verdict = field(default_factory=Verdict)
    first: int | None = None
    rows: frozenset[int] = frozenset()
    log_odds: float = 0.0

    @property
    def concerns_any(self) -> bool:
        """Whether a diagnosis concerns any row."""
        return self.first is not None or bool(self.rows)

    def concerns(self, row: int) -> bool:
        """Whether a row's numbers must not be used."""
        return row in self.rows or (self.first is not None and row >= self.first)


_Kept = tuple[int, Measured, np.ndarray]
"""A frame that is kept: its number, and the readings (2, K, 8) of the K rows before and of the K rows after."""
_Pictured = tuple[int, np.ndarray, float, np.ndarray]
"""A row, the points of its antenna (N, 2) px, their standard deviation, and the readings (8,)."""


@dataclass(eq=False)
class RecordingWatch:
    """Collects frames of a recording, in order and in 40 bytes a row besides those of some frames that it keeps.

    series : whether the rows follow each other; those picked out of a recording do not.
    """

    rig: Rig
    series: bool = True

    def __post_init__(self) -> None:
        self.count = 0
        self._first: list[_Kept] = []
        self._spread: list[_Kept] = []
        self._stride = 1
        self._time_s = math.nan  # of the row before
        self._read = np.empty((0, 8))  # readings of the last rows
        # the row in which the present picture was seen first, and its readings
        self._pictured: tuple[Measured, np.ndarray] | None = None
        self._repeated: list[int] = []
        self._moments = array("d")  # of all rows, N·m
        self._contradicted: list[int] = []
        self._seen = 0  # rows in which there is an antenna
        self._turned: Counter[str] = Counter()  # pictures that show one only otherwise, by how
        self._apart_s: deque[float] = deque(maxlen=64)
        self._axis = _image_of_axis(self.rig)
        self._pictures: list[_Pictured] = []  # rows that are yet to be compared, after the last two that were
        self._lateral: list[np.ndarray] = []  # (B, K) px, of the rows that were compared: `_lateral_px`
        self._compared = 0  # number of these rows
        self._jumps: list[int] = []  # rows with pictures that leap while the readings go on smoothly
        self._leaps = 0  # rows with a picture that leaps, whatever the readings do
        self._spikes: list[int] = []  # rows with a moment that leaps while the picture does not

    def push(self, measured: Measured, contact: Contact | None = None) -> None:
        """Add the next row."""
        points, sigma = measured.points_px, measured.sigma_px
        read = np.array([[*measured.readings, measured.pan_rad, measured.tilt_rad]])
        line = points, float(sigma[len(sigma) // 2]) if len(sigma) else math.nan
        reasons = [] if contact is None else [(0, contact)]
        self._add([line], read, np.array([measured.time_s]), lambda _: measured, [0], reasons)

    def followed(
        self, parts: Iterable[tuple[slice, Batch, Contacts]], frames: Sequence[Frame], overview: Overview
    ) -> Iterator[ContactTable]:
        """Contacts of `estimate_together` as tables, part by part; each is added to the watch and to `overview`."""
        names = tuple(dict.fromkeys((*overview.columns, "moment_Nm", "pan_rad", "tilt_rad")))
        columns = {name: numbers_of(frames, name) for name in (*names, "frame", "time_s")}
        for own, batch, contacts in parts:
            about = {name: each[own] for name, each in columns.items()}
            table = contacts.table({name: about[name] for name in ("frame", "time_s", "pan_rad", "tilt_rad")})
            self.push_together(batch, contacts)
            overview.add_table(table, about, np.column_stack([batch.outside_points, batch.point_counts]))
            yield table

    def push_together(self, batch: Batch, contacts: Contacts) -> None:
        """Add the next frames of a recording by one camera, and their contacts."""
        every = np.column_stack([batch.readings_Nm, batch.pan_rad, batch.tilt_rad])
        count = batch.point_counts
        many, middle = count.tolist(), batch.sigma_px[np.arange(len(batch)), count // 2].tolist()
        pictured = zip(batch.points_px, many, middle, strict=True)
        lines = [(points[:own], std if own else math.nan) for points, own, std in pictured]
        lost = np.flatnonzero(np.isin(contacts.status, ("failed", "no_antenna"))).tolist()
        times = np.full(len(batch), np.nan) if batch.time_s is None else batch.time_s
        self._add(lines, every, times, batch.measured, _may_repeat(batch), [(row, contacts[row]) for row in lost])

    def _add(
        self,
        lines: list[tuple[np.ndarray, float]],
        readings: np.ndarray,
        time_s: np.ndarray,
        measured: Callable[[int], Measured],
        may_repeat: list[int],
        reasons: list[tuple[int, Contact]],
    ) -> None:
        """Add B rows.

        lines : of each row the points (N, 2) and a standard deviation, px. readings : (B, 8). measured : all that was
        measured in a row. may_repeat : rows with a picture that may be that of the row before. reasons : rows without a
        contact point, with the contact that has the reason.
        """
        begin, before = self.count, 0
        self._moments.extend(readings[:, 0].tolist())
        for row in may_repeat:
            if row > before + 1:
                self._pictured = None
            self._note_picture(measured(row), readings[row], begin + row)
            before = row
        for row, contact in reasons:
            self._note_reason(contact, begin + row)
        later = np.diff(time_s, prepend=self._time_s)
        self._apart_s.extend(later[later > 0.0].tolist())
        self._pictures += [(begin + row, *line, readings[row]) for row, line in enumerate(lines)]
        self._follow(begin, readings)
        series = np.concatenate([self._read, readings])
        for row in (row for row, (points, _) in enumerate(lines) if len(points) >= RecordingSettings.fewest_points):
            self._seen += 1
            if self._keeps(begin + row):
                self._keep(measured(row), begin + row, self._around(series, len(self._read) + row))
        self._read, self.count = series[-RecordingSettings.lag_most :], begin + len(lines)
        if len(self._pictures) >= RecordingSettings.compared:
            self._compare()
        self._time_s = float(time_s[-1])

    def _note_picture(self, measured: Measured, now: np.ndarray, row: int) -> None:
        """Note a row that has the picture of those before although the antenna has moved by the readings."""
        if self._pictured is None or not _same_picture(measured, self._pictured[0]):
            self._pictured = measured, now
        elif self._moved(now, self._pictured[1]):
            self._repeated.append(row)

    def _note_reason(self, contact: Contact, row: int) -> None:
        """Note the finding on the recording in the reason of a row without a contact point, if there is one."""
        if contact.status == "failed" and "picture and moment contradict" in contact.reason:
            self._contradicted.append(row)
        if contact.status == "no_antenna":
            self._turned.update(words for words, *_ in ContactSettings.turned if words in contact.reason)

    def _follow(self, row: int, readings: np.ndarray) -> None:
        """Note the readings (B, 8) from a row on after the rows that are kept."""
        most = RecordingSettings.lag_most
        for kept in (self._first, self._spread):
            for number, _, around in reversed(kept):
                if row - number > most:
                    break
                after = around[1, row - number - 1 :]
                after[: len(readings)] = readings[: len(after)]

    def _around(self, series: np.ndarray, at: int) -> np.ndarray:
        """Readings (2, K, 8) before and after one of a series of them (N, 8), the nearest first; NaN where there is
        none."""
        most = RecordingSettings.lag_most
        around = np.full((2, most, 8), np.nan)
        for into, some in zip(
            around, (series[max(at - most, 0) : at][::-1], series[at + 1 : at + 1 + most]), strict=True
        ):
            into[: len(some)] = some
        return around

    def _compare(self) -> None:
        """Search the pending rows for jumps."""
        if not self._pictures:
            return
        number, lines_px, sigma_px, readings = zip(*self._pictures, strict=True)
        lateral = _lateral_px(*self._axis, lines_px)
        self._lateral.append(lateral[self._compared - number[0] :].astype(np.float32))
        self._compared = number[-1] + 1
        if len(number) < 3:
            return
        std_Nm = self.rig.moment_sensor.std_Nm
        leaps, smooth, spikes = _leaps(lateral, np.array(sigma_px), np.array(readings), std_Nm)
        self._spikes += [number[1 + k] for k in np.flatnonzero(spikes)]
        self._jumps += [number[1 + k] for k in np.flatnonzero(leaps & smooth)]
        self._leaps += int(np.count_nonzero(leaps))
        self._pictures = self._pictures[-2:]

    def _keeps(self, row: int) -> bool:
        """Whether a row is one of the frames kept as witnesses."""
        first = RecordingSettings.first
        return len(self._first) < first or not (row - first) % self._stride

    def _keep(self, measured: Measured, row: int, around: np.ndarray) -> None:
        """Keep a frame: the first ones, then every n-th, with n doubled whenever these are too many."""
        frame = row, measured, around
        if len(self._first) < RecordingSettings.first:
            self._first.append(frame)
        else:
            self._spread.append(frame)
            if len(self._spread) > 2 * RecordingSettings.spread:
                self._spread, self._stride = self._spread[::2], 2 * self._stride

    def _moved(self, now: np.ndarray, before: np.ndarray) -> bool:
        """Whether the antenna has moved by the readings (8,)."""
        off = np.abs(now - before)
        noise = 6.0 * self.rig.moment_sensor.std_Nm
        return bool(np.nanmax(off[:2], initial=0.0) > noise or np.nanmax(off[-2:], initial=0.0) > 1e-3)

    def snapshot(self) -> RecordingWatch:
        """A copy of the present state, which later rows do not change."""
        return deepcopy(self, {id(self.rig): self.rig})

    def recorded(self) -> Recorded:
        """The frames kept as witnesses."""
        chosen = spread_evenly(len(self._spread), RecordingSettings.spread)
        kept = [*self._first, *(self._spread[index] for index in chosen)]
        batch = Batch.of(self.rig, [measured for _, measured, _ in kept])
        around, order = np.array([around for *_, around in kept]), np.array([number for number, *_ in kept])
        drift = self.rig.drift
        # what may have changed is in the covariance from here on
        rig = replace(self.rig.drifted(), drift=Drift(line_px=drift.line_px, light_px=drift.light_px))
        period_s = self._period_s if self._in_time else math.nan
        found = Recorded(rig, batch, around, order, period_s)
        seen = np.isfinite(batch.points_px).all(axis=-1).sum(axis=-1)
        return found.picked(np.flatnonzero(seen >= RecordingSettings.fewest_points))

    def verdict(self) -> RecordingVerdict:
        """The verdict from all rows so far."""
        exchanged = self._exchanged()
        sure = [row for odds, *pair in exchanged if odds > DecisionSettings.least_log_odds for row in pair]
        elsewhere = [*self._repeated, *sure]  # rows with pictures that are not theirs
        found, rows, first, log_odds = self._of_series(exchanged), list(elsewhere), None, 0.0
        if self._first and len(recorded := self.recorded()) >= RecordingSettings.fewest:
            own = ~np.isin(recorded.order, elsewhere)
            if own.sum() >= RecordingSettings.fewest:
                recorded = recorded.picked(np.flatnonzero(own))
            coarse, recorded = self._coarse(recorded)
            saturated, recorded = self._saturated(recorded)
            rows += [row for _, own in saturated for row in own]
            unlike, late = self._unlike()
            if any(one.grave for one in unlike) and not late:
                recorded = recorded.without_moments
            case = Case.of(recorded, axes_of(recorded.rig, CHANGES)[0])
            rounds, left = explained(case, TABLE)
            of_other_rows = {"moment_late", "pictures_late", "clock_offset", "joints_late"}
            if late and not {one.diagnosis.name for best in rounds for one in best} & of_other_rows:
                case = Case.of(recorded.without_moments, axes_of(recorded.rig, CHANGES)[0])
                rounds, left = explained(case, TABLE)
            elif late:
                unlike = []
            coarse = [*coarse, *unlike]
            stuck = [one for one, _ in saturated if one.name == "moment_stuck"]
            found += [*coarse, *(one for one, _ in saturated if one not in stuck)]
            named, log_odds = causes(rounds, left.beyond_usual), rounds[0][0].log_odds if rounds else 0.0
            grave = [best[0] for best in rounds if best[0].diagnosis.grave]
            # a cause of all is one of single rows, too
            found = found if grave else [*found, *self._of_rows()]
            found = [*named, *found] if not found or not found[0].grave else [*found, *named]
            found += stuck  # at either end of the recording a wrong clock leaves the same reading, too
            found += [
                *self._scatter(case, named),
                *([] if grave or any(one.grave for one in unlike) else _untested(case)),
            ]
            begins = [one.first for one in grave] + [0] * any(one.grave for one in coarse)
            if (rest := self._unexplained(left, bool(grave))) is not None:
                found.append(rest)
                begins += [0] * rest.grave
            first = min(begins, default=None)
        return RecordingVerdict(Verdict.of(found), first, frozenset(rows), log_odds)

    def _saturated(self, recorded: Recorded) -> tuple[list[tuple[Diagnosis, list[int]]], Recorded]:
        """Moments at the end of the sensor's range, or at which it stops at times, with their rows, and the
        frames without these readings."""
        settings, found, read = RecordingSettings, list[tuple[Diagnosis, list[int]]](), recorded.batch.readings_Nm
        every, repeated, limits = np.array(self._moments), self._repeated_moments, self.limits
        others = every[np.isfinite(every) & ~np.isin(every, list(repeated))]
        fine = len(others) >= settings.fewest and len(np.unique(others)) > settings.distinct * len(others)
        # rounded ones are often alike
        fine = fine and _step(every[np.isfinite(every)]) < settings.fine_std * self.rig.moment_sensor.std_Nm
        for value in self.standing:
            at, rows = np.flatnonzero(read[:, 0] == value), repeated[value]
            largest = value == np.nanmax(every)
            many = len(at) > 0 and len(rows) >= settings.at_limit_share * self.count
            if not (fine or (many and value in limits and self._beyond(recorded.picked(at), value, largest))):
                continue  # the readings have few digits
            words = f"{len(rows)} of {self.count} moments are exactly"
            if value in limits and value != 0.0:
                words = f"{words} the {'largest' if largest else 'smallest'}, {value:.4g} N·m"
                words = f"{words}: the sensor is at the end of its range"
                remedy = "press less, or use a sensor or amplifier with more range"
                found.append((Diagnosis("moment_saturated", words, remedy, "wrong"), rows))
            else:
                words = f"{words} {value:.4g} N·m, and hardly any others alike: the sensor gave no reading there"
                remedy = "look for loose contacts, for a threshold, and for a range that ends there"
                found.append((Diagnosis("moment_stuck", words, remedy, "wrong"), rows))
            read = read.copy()
            read[read[:, 0] == value, 0] = np.nan
        return found, recorded.with_readings(readings_Nm=read)

    def _coarse(self, recorded: Recorded) -> tuple[list[Diagnosis], Recorded]:
        """Moments with few digits, or that are read less often than the pictures, and the frames with what these
        readings are good for: a larger noise, or only where they are new."""
        settings, std = RecordingSettings, recorded.rig.moment_sensor.std_Nm
        read = recorded.batch.readings_Nm[:, 0]
        series = np.column_stack([recorded.around[:, 0, ::-1, 0], read, recorded.around[:, 1, :, 0]])
        values = np.unique(series[np.isfinite(series) & ~np.isin(series, self.standing)])
        if len(values) < settings.fewest_values:
            return [], recorded
        if step := _step(values):
            remedy = "write moment_Nm with all its digits, or use an amplifier with finer steps"
            words = f"the moments come in steps of {step:.3g} N·m, {step / std:.0f} standard deviations of the noise"
            sensor = replace(recorded.rig.moment_sensor, std_Nm=float(np.hypot(std, step / np.sqrt(12.0))))
            found = _as_severe("moment_rounded", words, remedy, step / std)
            return found, replace(recorded, rig=replace(recorded.rig, moment_sensor=sensor)) if found else recorded
        change = np.diff(series, axis=1)
        kept = (change == 0.0) & ~np.isin(series[:, 1:], self.standing)
        share = kept.sum() / np.isfinite(change).sum()
        if not share > settings.kept:
            return [], recorded
        moved = float(np.nanquantile(np.abs(change[change != 0.0]), settings.typical)) / std
        words = (
            f"{100 * share:.0f} % of the moments are those of the row before: the sensor is read less often than the "
            f"camera, or sticks, while the moment moves by up to {moved:.0f} standard deviations of its noise at a time"
        )
        old = kept[:, recorded.around.shape[2] - 1]
        readings = np.where(old[:, None], np.nan, recorded.batch.readings_Nm)
        found = _as_severe("moment_kept", words, "read the sensor with each picture, or interpolate by time", moved)
        return found, recorded.with_readings(readings_Nm=readings) if found else recorded

    def _unlike(self) -> tuple[list[Diagnosis], bool]:
        """Diagnosis of moments and pictures that do not change together, and whether the moments are late or early by a
        known number of rows."""
        self._compare()
        settings, std = RecordingSettings, self.rig.moment_sensor.std_Nm
        lateral = np.concatenate(self._lateral or [np.empty((0, settings.places))])
        moments = np.array(self._moments)
        moments[np.isin(moments, self.standing)] = np.nan
        if not (self.rig.moment_sensor.exists and self.series and len(moments) == len(lateral) and self.count > 2):
            return [], False
        spread = float(np.nanstd(moments)) if np.isfinite(moments).any() else 0.0
        smooth = settings.smooth_share * spread > max(_scatter_std(0.0 * lateral, moments), std)
        if smooth and len(self._jumps) > settings.leaping * self.count:
            words = (
                f"in {len(self._jumps)} of {self.count} rows the picture leaps to and fro while the readings go on "
                "smoothly: pictures of other rows, or of several cameras"
            )
            remedy = "look how pictures and readings are matched, and whether all pictures are of this camera"
            return [Diagnosis("pictures_shuffled", words, remedy, "wrong")], False
        if not self._in_time:
            return [], False
        noise = _scatter_std(lateral, moments)
        if noise > settings.noisy_std * std and noise > settings.noisy_share * spread:
            words = (
                f"the moments leap by {noise / std:.0f} standard deviations of their noise from row to row while the "
                "pictures hardly change"
            )
            remedy = "look for loose contacts and hum, and whether the column is the moment, row by row"
            return [Diagnosis("moment_noise", words, remedy, "wrong")], False
        found = _following(lateral, moments, std)
        if found is None:
            return [], False
        log_odds, late_rows, filtered = found
        log_odds -= DecisionSettings.lead  # a push that follows another may look like it
        if log_odds < DecisionSettings.least_doubt:
            return [], False
        severity: Severity = "wrong" if log_odds > DecisionSettings.least_log_odds else "doubt"
        if late_rows:
            apart = f"{abs(late_rows):.2g} row{'s' * (abs(late_rows) != 1.0)}"
            when = "after" if late_rows > 0.0 else "before"
            words = f"the moments change about {apart} {when} their pictures do"
            if filtered:
                words = f"the moments follow their pictures as through a filter, with a time constant of {apart}"
            remedy = "take stamps of one clock, and no filter"
            return [Diagnosis("moment_late", words, remedy, severity)], severity == "wrong" and not filtered
        words = "the moments do not change when their pictures do: they are of other rows, or filtered, or no moments"
        return [
            Diagnosis("moment_dead", words, "check sensor, columns and clocks, or give --no-moment", severity)
        ], False

    def _beyond(self, some: Recorded, value: float, largest: bool) -> bool:
        """Whether pictures of some frames require a moment beyond `largest`."""
        expected, std = some.without_moments.fit.moments
        off = (expected - value) * (1.0 if largest else -1.0) / np.hypot(std, self.rig.moment_sensor.std_Nm)
        return bool((off[np.isfinite(std)] > RecordingSettings.beyond_std).any())

    def _of_series(self, exchanged: Sequence[tuple[float, int, int]]) -> list[Diagnosis]:
        """Diagnoses from the series of readings, times and pictures alone; `exchanged` as from `_exchanged`."""
        found = []
        if len(self._repeated) >= RecordingSettings.repeated:
            count, start = len(self._repeated), self._repeated[0]
            words = f"{count} rows, first row {start}, repeat the picture before them, while the readings go on"
            remedy = "look why the camera stopped, and leave these rows out"
            found.append(Diagnosis("camera_frozen", words, remedy, "wrong"))
        [(words, count)] = self._turned.most_common(1) or [("", 0)]
        if count > 1 and self._seen < RecordingSettings.unexplained * self.count:
            row = next(one for one in READINGS if one.words == words)
            found.append(Diagnosis(row.name, row.words, row.remedy, row.severity))
        elif self.count >= RecordingSettings.fewest and self._seen < RecordingSettings.unexplained * self.count:
            words = f"no antenna is seen in {self.count - self._seen} of {self.count} frames where the rig expects it"
            remedy = "look with vbaa look whether size, part and place of the pictures are those of the calibration"
            found.append(Diagnosis("antenna_unseen", words, remedy))
        if exchanged:
            odds, one, other = exchanged[0]
            words = f"the pictures of rows {one} and {other} fit better in each other's row"
            remedy = "look at their time stamps and names, and exchange them"
            severity: Severity = "wrong" if odds > DecisionSettings.least_log_odds else "doubt"
            found.append(Diagnosis("pictures_exchanged", words, remedy, severity))
        if self._period_s > RecordingSettings.apart_s:
            words = f"the frames are {self._period_s:.4g} s apart: their times may be in milliseconds or nanoseconds"
            found.append(Diagnosis("time_unit", words, "give time_s in seconds"))
        return found

    @property
    def _period_s(self) -> float:
        """Median time between the last rows; NaN where they have none."""
        return float(np.median(self._apart_s)) if self._apart_s else math.nan

    @property
    def _in_time(self) -> bool:
        """Whether the frames are a series in time: the pictures of others leap at most rows."""
        return self.series and self._leaps <= RecordingSettings.series * self.count

    def _exchanged(self) -> list[tuple[float, int, int]]:
        """Pairs of rows with pictures that may be exchanged, after their log odds, the likeliest first."""
        self._compare()
        if not self._jumps or not self._in_time:
            return []
        sigma_px = [float(np.median(each.sigma_px)) for _, each, _ in (*self._first, *self._spread)]
        jumps = self._jumps[: RecordingSettings.most_jumps]
        return _exchanged(np.concatenate(self._lateral), jumps, float(np.median(sigma_px or [np.nan])))

    def _of_rows(self) -> list[Diagnosis]:
        """Rows with readings that contradict their pictures."""
        leaping = self._spikes if self._in_time and len(self._spikes) >= RecordingSettings.spikes else []
        rows = sorted({*self._contradicted, *leaping})
        if not rows:
            return []
        count, first = len(rows), rows[0]
        remedy = "look for loose contacts and for rows that are exchanged"
        words = f"the moments of {count} rows contradict their pictures, first row {first}"
        if count == 1:  # in one frame the picture may be to blame
            return [Diagnosis("moment_spikes", f"the moment of row {first} contradicts its picture", remedy, "note")]
        return [Diagnosis("moment_spikes", words, remedy)]

    @property
    def _repeated_moments(self) -> dict[float, list[int]]:
        """Moments that several rows share exactly, with these rows."""
        moments = np.array(self._moments)
        order = np.argsort(moments, kind="stable")
        order = order[np.isfinite(moments[order])]
        values, begins, counts = np.unique(moments[order], return_index=True, return_counts=True)
        often = np.flatnonzero(counts >= RecordingSettings.at_limit) if len(values) > 1 else np.empty(0, int)
        return {float(values[k]): order[begins[k] : begins[k] + counts[k]].tolist() for k in often}

    @property
    def limits(self) -> tuple[float, ...]:
        """Moments at which the sensor may be at the end of its range."""
        moments = np.array(self._moments)
        ends = (np.nanmin(moments), np.nanmax(moments)) if np.isfinite(moments).any() else ()
        return tuple(value for value in self._repeated_moments if value in ends)

    @property
    def standing(self) -> tuple[float, ...]:
        """These, and the one moment between them at which the sensor stops at times."""
        repeated, limits = self._repeated_moments, self.limits
        within = [value for value in repeated if value not in limits]
        # several: the readings have few digits, or are read seldom; 0 is what many write where there is no reading
        alone = len(within) == 1 and (within[0] == 0.0 or len(repeated[within[0]]) >= RecordingSettings.fewest_standing)
        return (*limits, *within) if alone else limits

    def _scatter(self, case: Case, causes: Sequence[Diagnosis]) -> list[Diagnosis]:
        """Diagnoses of standard deviations that are too small, and of shapes that are not this antenna's."""
        kept = [measured for _, measured, _ in (*self._first, *self._spread)]
        some = kept[:: max(len(kept) // RecordingSettings.scatter, 1)]
        lines = [each.points_px for each in some], [each.sigma_px for each in some]
        own, found = point_scatter(*lines), list[Diagnosis]()
        remedy = "straighten or replace it where it is bent or kinked, and calibrate again"
        stated = max(own, *(each.sigma_factor for each in kept))
        # the rig knows of errors that neighbouring points share, as lines follow the pixels' rows
        drift, sigma_px = self.rig.drift, float(np.median([np.median(each) for each in lines[1]]))
        known = math.hypot(drift.line_px, drift.light_px, drift.lock_px) / max(sigma_px, 1e-9)
        if stated > math.hypot(OutlierSettings.tolerated, known):
            if shared_share(*lines) * stated**2 > RecordingSettings.shared * (stated**2 - 1.0):
                words = (
                    f"in all pictures alike the points lie {stated:.2g} times further off smooth curves than they may"
                )
                return [Diagnosis("antenna_bent", f"{words}: the antenna is kinked", remedy)]
            words = f"the points scatter {stated:.2g} times more than their standard deviations say"
            found.append(Diagnosis("sigma_too_small", words, "give sigma_px as the tracker's points scatter"))
        off = float(np.sqrt(np.median(case.scale))) / max(own if own > 0.0 else 1.0, 1.0)
        if off > RecordingSettings.other_shape and not causes:
            words = f"the antenna's points lie {off:.1f} times further off the shapes of this antenna than they scatter"
            found.append(Diagnosis("antenna_bent", words, remedy))
        return found

    def _unexplained(self, case: Case, corrected: bool) -> Diagnosis | None:
        """Diagnosis of frames that nothing in the table explains, in a case with or without something put right."""
        lost = case.lost
        (first, *_), least = case.splits, RecordingSettings.fewest // 2
        later = lost.sum() >= least and lost[first:].mean() > RecordingSettings.contradicting
        if not (lost.mean() > RecordingSettings.unexplained or later):
            return None
        alone = (case.recorded.without_moments.fit.cost - case.best)[lost] / case.scale[lost]
        by_moment = float(np.mean(alone < 0.5 * RecordingSettings.most))
        block = (
            "moments and pictures contradict each other"
            if by_moment > 0.5
            else "the shapes are not those of this antenna"
        )
        words = f"{lost.sum()} of {len(lost)} frames examined fit no contact, and no single cause explains it: {block}"
        if corrected:
            words = f"with that put right {words}"
        remedy = "look at the frames with --overlay, and run vbaa check with a free antenna"
        return Diagnosis(
            "unexplained", words, remedy, "wrong" if lost.mean() > RecordingSettings.contradicting else "doubt"
        )


def _as_severe(name: str, words: str, remedy: str, error_std: float) -> list[Diagnosis]:
    """A diagnosis of readings that may be off by so many standard deviations of their noise; none where that is
    little."""
    settings = RecordingSettings
    severity: Severity = "wrong" if error_std > settings.coarse_wrong_std else "doubt"
    return [Diagnosis(name, words, remedy, severity)] * (error_std > settings.coarse_std)


def _untested(case: Case) -> list[Diagnosis]:
    """Mistakes that the recording cannot reveal, in words."""
    recorded, found = case.recorded, []
    if not recorded.fit.free.any():
        words = "no frame shows the free antenna: a rig that has changed a little goes unnoticed"
        found.append(Diagnosis("no_free_frame", words, "begin recordings with ten frames without contact", "note"))
    if recorded.rig.moment_sensor.exists and not np.isfinite(recorded.batch.readings_Nm[:, 0]).any():
        words = "no moment was read: forces along the line of sight, and a sensor's faults, go unnoticed"
        found.append(Diagnosis("no_readings", words, "give moment_Nm where there is a sensor", "note"))
    elif recorded.rig.moment_sensor.exists and _unpredicted(case):
        words = "not tested, and forces along the line of sight depend on it: the moment sensor's gain, zero and filter"
        remedy = "record with a camera that leans across the antenna, or press against a known force"
        found.append(Diagnosis("moment_untested", words, remedy, "note"))
    joints = np.ptp(np.stack([recorded.batch.pan_rad, recorded.batch.tilt_rad]), axis=1).max()
    if joints == 0.0:
        pan, tilt = recorded.batch.pan_rad[0], recorded.batch.tilt_rad[0]
        words = f"all rows have pan {pan:.4g} and tilt {tilt:.4g} rad, which is right if the base stood still"
        found.append(Diagnosis("joints_untested", words, "connect the encoders if it moved", "note"))
    elif joints > RecordingSettings.joints_rad and (unseen := unseen_joints(case)):
        words = f"not tested, and places in the world depend on it: whether {', or '.join(unseen)}"
        remedy = "begin with ten frames of the free antenna over 20° of tilt or more"
        found.append(Diagnosis("joints_untested", words, remedy, "note"))
    return found


def _unpredicted(case: Case) -> bool:
    """Whether most pictures do not predict the moments that were read."""
    read = case.recorded.batch.readings_Nm[:, 0]
    there = np.isfinite(read)
    if there.sum() < RecordingSettings.fewest_moments:
        return False
    _, own = case.recorded.without_moments.fit.moments
    return bool(np.median(own[there]) > RecordingSettings.knows * float(np.ptp(read[there])))


def _step(moments: np.ndarray) -> float:
    """The step, N·m, of which moments (N,) are multiples; 0 where they are none."""
    values = np.unique(moments)
    if len(values) < 2:
        return 0.0
    step = float(np.diff(values).min())
    off = (values - values[0]) / step
    return step if np.abs(off - np.round(off)).max() < RecordingSettings.lattice else 0.0


def _same_picture(measured: Measured, before: Measured) -> bool:
    a, b = measured.points_px, before.points_px
    if not len(a) or a.shape != b.shape or (a[0, 0] != b[0, 0] and a[0, 0] == a[0, 0]):  # most of them
        return False
    return bool(np.array_equal(a, b, equal_nan=True))


def _may_repeat(batch: Batch) -> list[int]:
    """Rows with pictures that begin alike, one after the other, and the first and the last row."""
    begins = batch.points_px[:, 0] if batch.points_px.shape[1] else np.full((len(batch), 2), np.nan)
    same = (begins[1:] == begins[:-1]).all(axis=1)
    own = np.append(same, True) | np.append(True, same)
    return np.flatnonzero(own).tolist()


def _image_of_axis(rig: Rig) -> tuple[np.ndarray, np.ndarray]:
    """Image points (2,) of the antenna's clamp and, if it were straight, of its tip."""
    ends = np.array([[0.0, 0.0, 0.0], [rig.antenna.length_m, 0.0, 0.0]])
    clamp, tip = rig.camera.project(rig.T_antenna_camera.inverse() @ ends)[0]
    return clamp, tip


def _lateral_px(clamp: np.ndarray, tip: np.ndarray, lines_px: Sequence[np.ndarray]) -> np.ndarray:
    """(B, K) lateral distances of lines' points (N, 2) from the straight one from clamp to tip, at places along
    that."""
    settings, length = RecordingSettings, math.hypot(*(tip - clamp))
    found = np.full((len(lines_px), settings.places), np.nan)
    if not length > 0.0:
        return found
    thin = [points[:: max(len(points) // (4 * settings.places), 1)] for points in lines_px]
    along = (tip - clamp) / length
    row = np.repeat(np.arange(len(thin)), [len(points) * (len(points) >= settings.fewest_points) for points in thin])
    every = np.concatenate([points for points in thin if len(points) >= settings.fewest_points] or [found[:0, :2]])
    at, off = np.array([along, [-along[1], along[0]]]) @ (every - clamp).T
    there = np.isfinite(at + off)
    at, off, row = at[there], off[there], row[there]
    if not len(row):
        return found
    if not ((np.diff(at) > 0.0) | (np.diff(row) > 0)).all():
        order = np.lexsort((at, row))
        at, off = at[order], off[order]
    # one line after the other, as one
    places, apart = length * np.linspace(0.0, 1.0, settings.places + 1)[1:], 4.0 * (np.abs(at).max() + length)
    begins = np.flatnonzero(np.append(True, row[1:] != row[:-1]))
    rows = row[begins]
    first, last = at[begins, None], at[np.append(begins[1:], len(at)) - 1, None]
    between = np.interp(places + apart * rows[:, None], at + apart * row, off)
    found[rows] = np.where((places >= first) & (places <= last), between, np.nan)
    return found


def _leaps(
    lateral_px: np.ndarray, sigma_px: np.ndarray, readings: np.ndarray, moment_std_Nm: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Three masks (B − 2,) over the rows between the first and the last: pictures as far off the mean of their
    neighbours as these are apart; readings (B, 8) that go on smoothly; and moments far off both neighbours although
    their pictures are close to the mean of theirs.

    lateral_px : (B, K). sigma_px : (B,) standard deviations of the points. moment_std_Nm : the sensor's noise.
    """
    settings = RecordingSettings
    size = _unlike(lateral_px[1:-1], 0.5 * (lateral_px[:-2] + lateral_px[2:]))
    apart = _unlike(lateral_px[:-2], lateral_px[2:])
    off, change = np.abs(readings[1:-1] - 0.5 * (readings[:-2] + readings[2:])), np.abs(readings[:-2] - readings[2:])
    joint = np.arange(off.shape[1]) >= off.shape[1] - 2
    noise = np.where(joint, settings.varies_rad, settings.varies_std * moment_std_Nm)
    # what is not read says nothing
    smooth = ~(off > change + noise).any(axis=1)
    off_line = size > settings.jump_sigma * sigma_px[1:-1]
    spikes = off[:, 0] > settings.spike_share * change[:, 0] + settings.spike_std * moment_std_Nm
    return (size > settings.jumps * apart) & off_line, smooth, spikes & ~off_line & np.isfinite(size)


def _following(lateral_px: np.ndarray, moments_Nm: np.ndarray, std_Nm: float) -> tuple[float, float, bool] | None:
    """Log odds of moments (N,) that belong to pictures (N, K) of other rows, or come through a low-pass filter; by how
    many rows they are late (negative: early), or the filter's time constant in rows, 0 where no number stands out; and
    whether it is a filter. None where too few rows decide.

    In a few rows, of one push in one direction, the moment is about linear in the two largest components of what the
    pictures show. Those of other rows fit as well only where the moments are not this antenna's of that time.
    """
    settings, count = RecordingSettings, len(moments_Nm)
    shape = _components(lateral_px)
    most = min(settings.lag_most, count // settings.least_lags)
    if shape is None or most < 1:
        return None
    starts = np.arange(most, count - settings.window - most + 1, settings.window // 2)
    rows = starts[spread_evenly(len(starts), settings.most_windows), None] + np.arange(settings.window)
    # nothing follows from a moment that hardly changes
    rows = rows[np.ptp(moments_Nm[rows], axis=1) > settings.bends_std * std_Nm]
    read, floor = moments_Nm[rows], 0.5 * settings.varies_std * std_Nm
    lags, kept = np.delete(np.arange(-most, most + 1), most), np.exp(-1.0 / np.array(settings.filters_rows))
    before = moments_Nm[rows - 1]
    own, *others = [
        *(_misfits(shape[rows - lag], read, floor) for lag in (0, *lags)),
        *(_misfits(shape[rows], (read - part * before) / (1.0 - part), floor) for part in kept),
    ]
    gained = own - np.array(others)
    gained = gained[:, np.isfinite(gained).all(axis=0)]
    if gained.shape[1] < settings.fewest_windows:
        return None
    # where the antenna slides smoothly, moments are about linear in the pictures of any row near by
    left = np.sqrt(np.maximum(np.exp(4.0 * own / (settings.window - shape.shape[1] - 1)) - floor**2, 0.0))
    if not np.nanmedian(left / np.ptp(read, axis=1)) > settings.unlike:
        return None
    # one place where a push follows another, which two windows see, is not counted
    most_gained = np.sort(gained, axis=1)[:, -2:].clip(0.0)
    late, sharper = np.split(gained.sum(axis=1) - most_gained.sum(axis=1), [len(lags)])
    odds = [float(np.logaddexp.reduce(each) - np.log(len(each))) for each in (late, sharper)]
    if odds[1] > odds[0]:
        return odds[1], settings.filters_rows[int(np.argmax(sharper))], True
    best = int(np.argmax(late))
    lead = late[best] - late[np.abs(lags - lags[best]) > 1].max(initial=-np.inf)
    return odds[0], float(lags[best]) if lead > settings.hinted else 0.0, False


def _components(lateral_px: np.ndarray) -> np.ndarray | None:
    """(N, 2) two largest components of pictures (N, K) by the places that most of them show; NaN in other rows."""
    visible = np.isfinite(lateral_px)
    places = visible.mean(axis=0) > RecordingSettings.seen_share
    rows = visible[:, places].all(axis=1)
    if places.sum() < RecordingSettings.fewest_places or rows.sum() < RecordingSettings.fewest:
        return None
    off = lateral_px[:, places].astype(float)
    off -= np.median(off[rows], axis=0)
    _, directions = np.linalg.eigh(off[rows].T @ off[rows])
    found = off @ directions[:, -2:]
    return np.asarray(found / np.maximum(np.std(found[rows], axis=0), 1e-9))


def _misfits(shapes: np.ndarray, moments: np.ndarray, floor: float) -> np.ndarray:
    """(W,) negative log likelihoods of moments (W, n) that are linear in shapes (W, n, 2) with a scatter of their
    own, at least `floor`; NaN where a picture lacks."""
    design = np.concatenate([np.ones((*moments.shape, 1)), shapes], axis=-1)
    whole = np.isfinite(design).all(axis=(1, 2))
    design = np.where(whole[:, None, None], design, 0.0)
    normal = np.einsum("wip,wiq->wpq", design, design) + 1e-6 * np.eye(design.shape[-1])
    found = np.linalg.solve(normal, np.einsum("wip,wi->wp", design, moments)[..., None])
    left = moments - (design @ found)[..., 0]
    free = moments.shape[1] - design.shape[-1]
    # windows overlap by half
    cost = 0.25 * free * np.log((left**2).sum(axis=1) / free + floor**2)
    return np.where(whole, cost, np.nan)


def _scatter_std(lateral_px: np.ndarray, moments_Nm: np.ndarray) -> float:
    """Standard deviation of moments (N,) from row to row in the half of the rows with pictures (N, K) that change
    least; NaN where these are few."""

    def bends(values: np.ndarray) -> np.ndarray:
        return np.asarray(values[1:-1] - 0.5 * (values[:-2] + values[2:]))

    square, off = bends(lateral_px) ** 2, bends(moments_Nm)
    compared = np.isfinite(square).sum(axis=1) >= RecordingSettings.fewest_places
    compared &= np.isfinite(off)
    if compared.sum() < 2 * RecordingSettings.fewest:
        return float("nan")
    size = np.nanmean(square[compared], axis=1)
    calm = np.abs(off[compared][size <= np.median(size)])
    return float(np.median(calm) / NORMAL_QUARTILE / np.sqrt(1.5))


def _exchanged(lateral_px: np.ndarray, jumps: Sequence[int], sigma_px: float) -> list[tuple[float, int, int]]:
    """Pairs of rows, one of them a jump, with pictures that may be exchanged, each row once: log odds and rows, the
    likeliest first. lateral_px : (N, K) of all rows. sigma_px : standard deviation of the points."""
    pairs, settings = [], RecordingSettings
    around = np.full_like(lateral_px, np.nan)
    around[1:-1] = 0.5 * (lateral_px[:-2] + lateral_px[2:])
    size = _unlike(lateral_px, around)
    scale = float(np.fmax(np.nanmedian(size[1:-1]), sigma_px)) if np.isfinite(size).any() else np.nan
    beforehand = settings.unlikely + math.log(len(lateral_px) * max(len(jumps), 1))
    for row in jumps:
        # each picture between the other's neighbours
        left = np.maximum(_unlike(lateral_px[row], around), _unlike(lateral_px, around[row]))
        left[row] = np.nan
        for other in np.argsort(left)[: settings.most_jumps].tolist():
            gained = _smoother(lateral_px, row, other, scale)
            if gained - beforehand > DecisionSettings.least_doubt:
                pairs.append((gained - beforehand, min(row, other), max(row, other)))
    found: list[tuple[float, int, int]] = []
    for odds, one, other in sorted(set(pairs), reverse=True):
        # the neighbours of two exchanged rows seem to be exchanged, too
        if not any(abs(row - each) < 2 for _, *pair in found for each in pair for row in (one, other)):
            found.append((odds, one, other))
    return found


def _smoother(lateral_px: np.ndarray, one: int, other: int, scale_px: float) -> float:
    """Log likelihood gained by exchanging two pictures, twice that of the row, with its neighbours, that gains less.

    Where a contact begins or ends, many a picture fits better than the row's own. Distances from the mean of the rows
    on either side have a Cauchy distribution of that scale.
    """
    rows = np.array([[row - 1, row, row + 1] for row in (one, other)])
    places = np.stack([rows - 1, rows, rows + 1]).clip(0, len(lateral_px) - 1)
    swapped = np.where(places == one, other, np.where(places == other, one, places))
    before, here, after = lateral_px[np.stack([places, swapped], axis=1)]
    cost = np.log1p((_unlike(here, 0.5 * (before + after)) / scale_px) ** 2)
    cost[:, (rows == 0) | (rows == len(lateral_px) - 1)] = 0.0
    return 2.0 * float(np.nansum(cost[0] - cost[1], axis=1).min())


def _unlike(one_px: np.ndarray, other_px: np.ndarray) -> np.ndarray:
    """(...) rms distance of two lines (..., K) over the places where both are visible; NaN where these are too few."""
    square = (one_px - other_px) ** 2
    seen = np.isfinite(square)
    count = seen.sum(axis=-1)
    mean = np.where(seen, square, 0.0).sum(axis=-1) / np.maximum(count, 1)
    return np.where(count >= RecordingSettings.fewest_places, np.sqrt(mean), np.nan)


def recording_verdict(rig: Rig, several: Sequence[Measured], contacts: Sequence[Contact]) -> Verdict:
    """The verdict on a recording that was estimated."""
    watch = RecordingWatch(rig)
    for measured, contact in zip(several, contacts, strict=True):
        watch.push(measured, contact)
    return watch.verdict().verdict
