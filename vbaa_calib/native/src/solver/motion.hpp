// How the antenna's pieces accelerate: least-squares parabolas over neighbouring frames.
#pragma once

#include <cstdint>

#include "arrays.hpp"

namespace vbaa::solver {

// Second derivatives of points (n, G, 3) at times (n,) in the judged frames (R,), their standard deviations, and the
// response of `Inertia` in Python: (R, G, 3), (R, G, 3), (R,). NaN where there are not frames enough for a parabola.
//
// Counted are the frames within a quarter of the mode's (R,) period, the next in any case; `live`: only earlier ones,
// two in any case; no more than `most` on either side. A gap longer than `longest_s`, or none at all, ends them. sigma:
// (n, 1) or (n, G) that of one component of a point. Where frames are many and the points scatter about a smooth path
// by more, the result's grows by as much; it never shrinks.
void accelerations(ConstVector time_s, ConstCube points, ConstMatrix sigma, View<const std::int64_t, 1> judged,
                   ConstVector mode_rad_s, double longest_s, int most, bool live, Cube second, Cube deviation,
                   Vector response);

}  // namespace vbaa::solver
