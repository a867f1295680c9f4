"""What tables may hold that cannot be: of a session, of deflections, of contacts."""

from __future__ import annotations

from . import damage as d
from .case import Case, Row, cases
from .every_file import CALIBRATE, CALIBRATE_SWEPT, CHECK, ESTIMATE, HANDEYE, REFINE


def numbers(line: int, column: str, remedy: str = "a finite number") -> tuple[Row, ...]:
    """What a number's cell may hold that is none."""
    return (
        (f"NaN for {column}", d.cell(line, column, "NaN"), f"line {line}", f"{column} is NaN", remedy),
        (f"endless for {column}", d.cell(line, column, "-inf"), f"line {line}", f"{column} is -inf", remedy),
        (
            f"beyond all numbers for {column}",
            d.cell(line, column, "1e999"),
            f"line {line}",
            f"{column} is 1e999",
            remedy,
        ),
        (f"text for {column}", d.cell(line, column, "much"), f"line {line}", f"{column} is 'much'", "a number"),
        (f"a number with its unit for {column}", d.cell(line, column, "1 mm"), f"line {line}", f"{column} is '1 mm'"),
        (f"100000 digits for {column}", d.cell(line, column, 100_000 * "9"), f"line {line}", f"{column} is 999"),
        (f"an underscore for {column}", d.cell(line, column, "1_0"), f"line {line}", f"{column} is '1_0'"),
    )


def table(column: str) -> tuple[Row, ...]:
    """What befalls every table; `column` is one that it needs."""
    return (
        ("a header alone", d.changed(lambda data: data.split(b"\n")[0] + b"\n"), "has a header but no rows"),
        ("no header", d.changed(lambda data: data.partition(b"\n")[2]), "is missing"),
        ("a column under another name", d.text(column, "other"), f"column {column} is missing"),
        ("a column twice", d.changed(lambda data: twice(data, column)), f"column {column} stands twice"),
        ("a row cut short", d.changed(lambda data: data.rstrip().rpartition(b",")[0]), "line", "cells, the header"),
        ("a cell too many", d.changed(lambda data: data.rstrip() + b",1\n"), "line", "cells, the header"),
        ("a quote that stays open", d.changed(lambda data: data.rstrip() + b'\n"'), "is not a valid CSV"),
        ("a cell of 200 kB", d.changed(lambda data: data.rstrip() + b"\n" + 200_000 * b"x"), "is not a valid CSV"),
        ("nothing but commas", d.content(b",,,,,\n,,,,,\n"), "is empty"),
    )


def twice(data: bytes, column: str) -> bytes:
    lines = data.decode().splitlines()
    at = lines[0].split(",").index(column)
    return "\n".join(f"{line},{line.split(',')[at]}" for line in lines).encode()


NOLOAD: tuple[Row, ...] = (
    ("degrees", d.cell(2, "tilt_rad", "20"), "line 2", "give radians"),
    ("a picture twice", d.cell(3, "image", "noload_000.png"), "line 3", "stands in line 2, too"),
    ("no picture named", d.cell(2, "image", ""), "line 2", "image is empty"),
    ("a picture with a name of 5000 letters", d.cell(2, "image", 5000 * "x"), "line 2", "is not there"),
    ("a moment without a number", d.cell(2, "moment_Nm", ""), "line 2", "moment_Nm is ''"),
    ("a moment in another unit", d.text("moment_Nm", "moment_mNm"), "column moment_Nm is missing"),
)
SWEEP: tuple[Row, ...] = (
    ("degrees", d.cell(2, "tilt_rad", "20"), "line 2", "give radians"),
    ("a picture twice", d.cell(3, "image", "board_000.png"), "line 3", "stands in line 2, too"),
    ("no picture named", d.cell(2, "image", ""), "line 2", "image is empty"),
)
LOADS: tuple[Row, ...] = (
    ("a distance in cm", d.cell(2, "distance_m", "10"), "line 2", "the antenna 0.24 m long"),
    ("at the clamp", d.cell(2, "distance_m", "0"), "line 2", "distance_m is 0"),
    ("no force", d.cell(2, "force_y_N", "0"), "line 2", "the force is zero"),
)
RECORDING: tuple[Row, ...] = (
    ("a frame twice", d.cell(4, "frame", "1"), "line 4", "frame 1 stands"),
    ("a frame below zero", d.cell(4, "frame", "-1"), "line 4", "frame is -1"),
    ("half a frame", d.cell(4, "frame", "1.5"), "line 4", "frame is 1.5"),
    ("a frame of 20 digits", d.cell(4, "frame", "9" * 20), "line 4", "frame is 9999"),
    ("time runs backwards", d.cell(4, "time_s", "0.05"), "line 4", "the time runs backwards"),
    ("degrees", d.cell(3, "pan_rad", "-90"), "line 3", "give radians"),
    ("a moment under another name", d.text("moment_Nm", "moment_mNm"), "but there is moment_mNm"),
    ("a moment with its unit", d.cell(3, "moment_Nm", "1 mNm"), "line 3", "moment_Nm is '1 mNm'"),
)
CENTRELINES: tuple[Row, ...] = (
    ("of no frame", d.cell(3, "frame", "9"), "frame 9 is not in recording.csv"),
    ("no deviation", d.cell(3, "sigma_px", "0"), "line 3", "sigma_px is not positive"),
    ("a point of no number", d.cell(3, "u_px", ""), "line 3", "u_px is ''"),
)
CONTACTS: tuple[Row, ...] = (
    ("a frame twice", d.cell(3, "frame", "0"), "line 3", "frame 0 stands already in line 2"),
    ("time runs backwards", d.cell(3, "time_s", "-1"), "line 3", "time_s runs backwards"),
    ("a status that is none", d.cell(3, "status", "fine"), "line 3", "status"),
    ("contact is maybe", d.cell(3, "in_contact", "maybe"), "line 3", "in_contact"),
    ("a point without a number", d.cell(3, "X_m", ""), "line 3", "X_m"),
    ("a contact at the clamp", d.cell(3, "distance_m", "0"), "line 3", "distance_m is 0 in a row that is"),
    ("a covariance below zero", d.cell(3, "cov_XX", "-1e-6"), "line 3", "cov"),
    ("a covariance that is none", d.cell(3, "cov_XY", "1"), "line 3", "cov"),
)
OF_ANOTHER: tuple[Row, ...] = (
    ("a frame of another session", d.cell(5, "frame", "99"), "no frame 99", "give the session"),
    ("a time of another session", d.cell(5, "time_s", "1000"), "has another time", "give the session"),
    ("a joint angle of another session", d.cell(2, "pan_rad", "0.3"), "other joint angles", "give the session"),
    ("a contact of another rig", d.cell(3, "X_m", "0.5"), "do not fit the rig's kinematics"),
    ("no contacts", d.changed(lambda data: data.replace(b",ok,true", b",failed,true")), "no frame has a contact point"),
)
STIFFNESS: tuple[Row, ...] = (
    ("three readings", d.changed(lambda data: b"\n".join(data.split(b"\n")[:4])), "has 3 readings"),
    ("in mm", d.cell(6, "loaded_y_m", "6.6"), "deflected by 6.6 m"),
    ("x in mm", d.cell(6, "x_m", "200"), "line 6", "beyond the load"),
    ("x twice", d.cell(3, "x_m", "0.04"), "line 3", "a second time"),
    ("no deflection", d.changed(lambda data: same(data)), "equals unloaded_y_m"),
    ("against the force", d.changed(lambda data: data.replace(b",0,0.", b",0,-0.")), "run against the force"),
)


def same(data: bytes) -> bytes:
    head, *rows = data.decode().split()
    return "\n".join([head, *(f"{row.split(',')[0]},0,0" for row in rows)]).encode()


POSES: tuple[Row, ...] = (
    ("a view twice", d.cell(3, "view", "board_000.png"), "line 3", "view board_000.png stands twice"),
    ("a view twice, once without its suffix", d.cell(3, "view", "board_000"), "view board_000.png stands twice"),
    ("a view without a name", d.cell(3, "view", ""), "line 3", "view is empty"),
    (
        "views of another set",
        d.changed(lambda data: data.replace(b"board_", b"frame_")),
        "no row is of one of the views",
    ),
    ("half a quaternion", d.cell(2, "qx", "9"), "line 2", "the quaternion's length is"),
    ("Euler angles", d.text("qx,qy,qz,qw", "a_deg,b_deg,c_deg,d"), "needs their order", "--euler", "ZYX"),
)
CORNERS: tuple[Row, ...] = (
    ("a corner that the board has not", d.cell(3, "id", "4000"), "line 3", "corner 4000, but the board has"),
    ("a corner below zero", d.cell(3, "id", "-1"), "line 3", "a whole number from 0 on"),
    ("a corner twice", d.changed(lambda data: data + data.split(b"\n")[1] + b"\n"), "stands twice"),
    ("a corner outside", d.cell(3, "u_px", "1e6"), "line 3", "outside the picture"),
    ("a corner of no view", d.cell(3, "view", ""), "line 3", "view is empty"),
    ("one corner", d.changed(lambda data: b"\n".join(data.split(b"\n")[:2])), "0 of 1 views can be used"),
)


STIFF = "stiffness stiffness.csv --load 0.01 --distance 0.2 -o out.json"

CASES: list[Case] = [
    *cases("noload.csv", "session/noload/noload.csv", CALIBRATE, table("tilt_rad") + numbers(2, "pan_rad") + NOLOAD),
    *cases("noload.csv", "session/noload/noload.csv", CHECK, table("image")[::3] + numbers(3, "moment_Nm")),
    *cases("loads.csv", "session/loads/loads.csv", CALIBRATE, table("force_z_N") + numbers(3, "force_y_N") + LOADS),
    *cases("loads.csv", "session/loads/loads.csv", CHECK, numbers(2, "distance_m") + LOADS),
    *cases("sweep.csv", "swept/sweep/sweep.csv", CALIBRATE_SWEPT, table("pan_rad") + numbers(4, "pan_rad") + SWEEP),
    *cases(
        "recording.csv",
        "session/recording/recording.csv",
        ESTIMATE,
        table("time_s") + numbers(4, "moment_Nm") + numbers(3, "time_s") + RECORDING,
    ),
    *cases(
        "centrelines.csv",
        "lined/recording/centrelines.csv",
        "estimate lined --rig rig.json -o out.csv",
        table("u_px") + numbers(5, "v_px") + CENTRELINES,
    ),
    *cases("poses.csv", "poses.csv", HANDEYE, table("qw") + numbers(3, "y_m") + POSES),
    *cases("corners.csv", "corners.csv", HANDEYE, table("u_px")[:4] + numbers(3, "v_px") + CORNERS),
    *cases("stiffness.csv", "stiffness.csv", STIFF, table("unloaded_y_m") + numbers(3, "loaded_y_m") + STIFFNESS),
    *cases(
        "contacts.csv",
        "contacts.csv",
        "track contacts.csv -o out.csv",
        table("status") + numbers(3, "distance_m", "") + CONTACTS,
    ),
    *cases("contacts.csv", "contacts.csv", "reconstruct contacts.csv -o out.glb", numbers(3, "Y_m", "") + CONTACTS),
    *cases("contacts.csv", "contacts.csv", REFINE, CONTACTS + numbers(3, "distance_m", "")),
    *(Case(name, "contacts.csv", "contacts.csv", damage, REFINE, tuple(words)) for name, damage, *words in OF_ANOTHER),
    *cases("contacts.csv", "contacts.csv", "report contacts.csv -o out.html", CONTACTS[::2]),
    *cases("contacts.csv", "contacts.csv", "view contacts.csv --html out.html", CONTACTS[1::2]),
]
