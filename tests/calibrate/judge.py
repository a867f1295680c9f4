from vbaa_calib.diagnose.session import session_diagnoses
from vbaa_calib.geometry import Kinematics


def said(rep):
    return session_diagnoses(rep.session, Kinematics(), rep.observations, rep.before)
