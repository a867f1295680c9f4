"""Settings of patches, shapes and meshes."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians


@dataclass(frozen=True)
class SurfaceSettings:
    """Thresholds by which touches become patches, shapes and a mesh."""

    most_touches: int = 500  # more are thinned evenly: the solve costs their number cubed
    biased_std: float = 1.0  # predicted bias from which a contact is not used, in its standard deviations
    link_normals_rad: float = radians(50)  # neighbours with more between their normals are on different sides
    patch_normals_rad: float = radians(65)  # largest angle of a normal from its patch's mean: a patch is a height field
    link_factor: float = 3.0  # width of a gap over the usual one up to which it is bridged
    link_extent: float = 0.25  # largest width of a bridged gap, over the extent of all touches
    neighbours: int = 8  # neighbours that decide a contact's side together: friction cancels in them
    alike_rad: float = radians(75)  # difference of normals below which neighbours decide together
    resolved: float = 4.0  # width over the contacts' own spread from which a patch is an area
    narrow: float = 0.02  # least width over length of an area
    fewest_touches: int = 4  # fewest touches of an area
    least_std_m: float = 1e-7  # least standard deviation of a point
    least_std_rad: float = 3e-4  # least standard deviation of a tangent
    unseen_bend_per_m: float = 50.0  # prior standard deviation of the curvature across a curve
    round_m: float = 0.03  # prior standard deviation of the radius about an axis across a curve
    ignored: float = 1e8  # factor on the covariance of a touch that is left out
    most_off_m: float = 1e-3  # largest correction of a point: worse contacts are left out
    slack_m: float = 0.05  # distance of touches from a curve for other reasons than its shape, per rad of slack
    unbelieved_rad: float = 10.0  # standard deviation of a tangent that is not used
    fewest_rounds: int = 3  # alternations of shape and normals
    learning_rounds: int = 2  # first rounds, in which the smoothness is estimated anew
    most_rounds: int = 15  # most rounds
    not_converged_std: float = 0.1  # step of the compliance after all rounds, in standard deviations, that is too large
    converged_std: float = 1e-3  # step at which the rounds end, in standard deviations
    growing: float = 2.0  # step over the least one before it from which the rounds will not converge
    outlier_std: float = 5.0  # standard deviations off the others' prediction from which a touch is left out
    most_outliers: float = 0.1  # share of touches left out, most: beyond it the covariances are at fault
    vague_m: float = 1e-3  # standard deviation along the surface from which a touch may be too vague
    vague_factor: float = 3.0  # the same over that of most touches, from which it is not used
    steepest: float = 3.0  # largest slope during the solve
    sharpest_m: float = 3e-4  # least radius of a bend during the solve
    unknown_rad: float = 1.0  # standard deviation of an unknown normal
    force_std_rad: float = 0.35  # standard deviation of a normal from which the force's direction replaces it
    tangent_std_rad: float = 1e-3  # own error of a tangent
    modes: int = 24  # common errors of the normals that are kept; the rest is each touch's own
    modes_end: float = 1e-7  # residual of these modes, over the largest variance, at which their search ends
    interval_std: float = 1.96  # standard deviations of a 95 % interval
    least_variation: float = 0.05  # relative spread of the normal forces that shows a compliance
    model_m: float = 1e-5  # shift of contacts over the forces that the model leaves out
    model_share: float = 0.015  # the same over the compliance: noise along the antenna flattens what is bent
    guessed_std_m: float = 2e-4  # standard deviation of touches without covariance, for smoothing
    tolerated_scatter: float = 1.5  # scatter over the stated one from which all touches are widened
    fewest_scattered: int = 12  # fewer touches do not determine their scatter
    cells: int = 44  # cells of the mesh along the longer side of a patch
    closing: float = 0.6  # bridged gaps within which touches on all sides enclose the footprint
    margin: float = 0.03  # margin of the footprint beyond the outermost touches, over the patch's extent
    line_gap: float = 0.1  # part of its length over which a line runs on
    nearby: float = 0.05  # part of a line's length within which contacts determine its normals
    vague_touches: float = 3.0  # touches known so many times worse than most do not widen the footprint
    lone_drawn_m: float = 2e-3  # standard deviation up to which a single place is drawn
    drawn_factor: float = 2.5  # standard deviation over that at nine tenths of the touches from which no mesh is drawn
    drawn_m: float = 3e-4  # and where it exceeds this, too
    most_equations: int = 480  # of the search for the smoothness: three numbers need no more
    incline: float = 2.0  # prior standard deviation of the trend's slope over the tangent plane
    rougher: float = 1e-4  # least part of the touches' variance that is noise, in the search
    fewest_thinned: int = 240  # equations from which on the search begins with a part of them
    thinned: int = 3  # one equation in so many is in that part
    difference_step: float = 1e-3  # step of the logarithms for the objective's first second derivatives
    least_bend: float = 1.0  # least second derivative of the objective that is assumed
    longest_step: float = 1.0  # longest step of the search
    search_steps: int = 60  # most steps of the search
    search_ends: float = 1e-4  # step at which the search ends
    lost_digits: float = 1e-9  # relative rise of the objective that counts as rounding
