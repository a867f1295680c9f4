// Measures the antenna to a fraction of a pixel: its cross-section, as the picture shows it, fitted to raw profiles.
// Raw pixels of every column that it crosses (of every row where it runs more upward than sideways), because
// interpolated ones share their noise, and shift a thin line with its phase on the pixel grid.
#pragma once

#include <optional>

#include "detect/visible_end.hpp"

namespace vbaa::detect {

constexpr int LEAST_PROFILES = 8;  // for there to be a line, and for its noise to be measured

// A line fitted to N profiles, not yet accepted as the antenna.
struct FittedLine {
    Numbers centre, course;  // (N,) along the profiles, px; the course is smooth
    Numbers sigma_px;        // (N,) standard deviation across the line
    Numbers effective_px;    // (N,) the same of a point that counts as independent
    Flags kept;              // (N,) where it was measured
    Numbers height;          // (N,) grey levels
    double noise;            // of a pixel, grey levels
    double breadth;          // over what an antenna in focus has
    bool changing;           // whether it may be brighter in some places and darker in others
    double sure;             // mean certainty over the kept points that it is a line, not one edge
};

// One place along the guide, as in Python's `Visibility`.
enum Visibility : unsigned char { SEEN, HIDDEN, OUTSIDE, BEYOND };

// Appearance of a fitted line, on which acceptance.py decides.
struct Evidence {
    Table everywhere, guide;  // (N, 2) its points, seen or not, and the smooth course through them
    Flags visibility;         // (N,) a `Visibility` each
    double seen, inside;      // parts of the path where it is seen, and in the picture
    double root;              // part of the path's beginning where it is seen
    double height;            // median, grey levels
};

// The kept points (N,) without `margin` of them on either side of a gap, and without runs between two gaps that are too
// short to be a line; one or two profiles hidden by noise are no gap.
Flags without_margins(const Flags& kept, int margin);

// The evidence of a line with at least one kept point.
Evidence evidence(const Crossings& found, const FittedLine& line);

// Of the ribbon's line, too:
constexpr double STRAY = 5.0, STRAY_PX = 0.12;  // deviations, and px, off a smooth curve: another thing's point
constexpr int CURVE_PIECES = 12;  // of the curve that points scatter about: it must not follow what neighbours share
constexpr int NEAR_POINTS = 41;   // neighbours: their scatter is compared with their deviations
constexpr int SHARED_RUN = 100;   // neighbours that a wrong cross-section, light or blur shifts alike, about
constexpr double LIKELY_POINTS = 20.0;  // that scatter as predicted are added to those that are seen
constexpr int END_PROFILES = 40;        // before the visible end, that show what the antenna looks like there

// How the line is measured.
struct Measuring {
    double width_px;
    int half;      // profiles have 2·half + 1 pixels
    double sign;   // 1: brighter than its background, −1: darker
    double taper;  // part by which the antenna is broader at the path's end than at its start; 0 of a uniform one
    double quiet;  // the noise quantile of the root mean square of as many normal numbers as a profile has freedoms
    const Shapes& shapes;
};

struct MeasuredLine {
    FittedLine line;
    Evidence evidence;
    VisibleEnd end;
    double lopsided_px = 0.0;  // by how much a highlight may pull it, of a broad line that no symmetric one fits
};

// Factor by which errors that neighbours share increase the scatter of means of runs over that of independent points.
// normalised: (M,) offsets. trusted: (M,) weights of the points.
double shared_factor(const Numbers& normalised, const Numbers& trusted);

// The line along a path (K, 2) near the antenna; none where no profile shows it. A point is kept where its height
// stands out from the noise and agrees with its neighbours', its profile leaves no more residual than noise does, and
// it lies on a smooth curve with the others.
std::optional<MeasuredLine> measured(const Picture& picture, ConstMatrix path_px, const Measuring& how);

}  // namespace vbaa::detect
