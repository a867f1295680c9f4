// Measures the antenna to a fraction of a pixel: its cross-section, as the picture shows it, fitted to raw profiles.
// Raw pixels of every column that it crosses (of every row where it runs more upward than sideways), because
// interpolated ones share their noise, and shift a thin line with its phase on the pixel grid.
#pragma once

#include <optional>

#include "detect/acceptance.hpp"
#include "detect/visible_end.hpp"

namespace vbaa::detect {

// How the line is measured.
struct Measuring {
    double width_px;
    int half;      // profiles have 2·half + 1 pixels
    int polarity;  // 1: brighter than its background, −1: darker, 0: here brighter, there darker
    double taper;  // part by which the antenna is broader at the path's end than at its start; 0 of a uniform one
    double quiet;  // the noise quantile of the root mean square of as many normal numbers as a profile has freedoms
    const Shapes& shapes;
};

struct MeasuredLine {
    FittedLine line;
    Evidence evidence;
    VisibleEnd end;
};

// By which factor what neighbours share makes means of runs scatter more than those of independent points: normalised
// offsets (M,) of points that count so much (M,).
double shared_factor(const Numbers& normalised, const Numbers& trusted);

// The line along a path (K, 2) near the antenna; none where no profile shows it. A point is kept where its height
// stands out from the noise and agrees with its neighbours', its profile leaves no more residual than noise does, and
// it lies on a smooth curve with the others.
std::optional<MeasuredLine> measured(const Picture& picture, ConstMatrix path_px, const Measuring& how);

}  // namespace vbaa::detect
