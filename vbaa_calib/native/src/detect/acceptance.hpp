// What fitted profiles look like: evidence for whether they are the antenna, and what of it is visible or hidden.
#pragma once

#include "detect/line_shape.hpp"
#include "detect/path_refinement.hpp"

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
    bool changing;           // whether it may be here brighter, there darker
    double sure;             // mean over what is kept of how surely it is a line, not one edge
};

// One place along the guide, as in Python's `Visibility`.
enum Visibility : unsigned char { SEEN, HIDDEN, OUTSIDE, BEYOND };

// What a fitted line looks like; acceptance.py says what of it counts against the antenna.
struct Evidence {
    Table everywhere, guide;  // (N, 2) its points, seen or not, and the smooth course through them
    Flags visibility;         // (N,) a `Visibility` each
    double seen, inside;      // parts of the path where it is seen, and in the picture
    double root;              // part of the path's beginning where it is seen
    double height;            // median, grey levels
};

// The kept points (N,) but for so many on either side of a gap, and without those that are too few between two gaps for
// there to be a line; a profile or two that noise hides are no gap.
Flags without_margins(const Flags& kept, int margin);

// Of a line that is kept somewhere.
Evidence evidence(const Crossings& found, const FittedLine& line);

}  // namespace vbaa::detect
