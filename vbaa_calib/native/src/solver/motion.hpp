// How the antenna's pieces accelerate: least-squares parabolas over neighbouring frames.
#pragma once

#include <cstdint>

#include "arrays.hpp"

namespace vbaa::solver {

// Points (n, G, 3) at times (n,). sigma: (n, 1) or (n, G) standard deviation of one component of a point.
struct Moved {
    ConstVector time_s;
    ConstCube points;
    ConstMatrix sigma;
};

// Frames (R,) that are judged, and the first mode (R,) of the antenna in each. Counted are the frames within a quarter
// of its period, the next in any case; `live`: only earlier ones, two in any case; no more than `most` on either side.
// A gap longer than `longest_s`, or none at all, ends them.
struct JudgedFrames {
    View<const std::int64_t, 1> frames;
    ConstVector mode_rad_s;
    double longest_s;
    int most;
    bool live;
};

// Second derivatives of the points (R, G, 3), their standard deviations, and the response (R,) of `Inertia` in Python.
struct Accelerations {
    Cube second, deviation;
    Vector response;
};

// NaN where there are not frames enough for a parabola. Where frames are many and the points scatter about a smooth
// path by more than they should, the deviation grows by as much; it never shrinks.
void accelerations(const Moved& moved, const JudgedFrames& judged, const Accelerations& found);

}  // namespace vbaa::solver
