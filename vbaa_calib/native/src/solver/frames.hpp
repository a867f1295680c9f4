// Many frames' data as they come from Python, and one of them as the fit takes it.
#pragma once

#include <cstdint>

#include "lens.hpp"
#include "solver/structs.hpp"

namespace vbaa::solver {

// B frames of N points at most, see `Frames` in Python.
struct Frames {
    ConstCube points, covariance;            // (B, N, 2) in the ideal picture, (B, N, 3) xx, xy, yy
    ConstMatrix usable;                      // (B, N) 1 for a point, 0 for what is missing
    View<const std::int64_t, 2> camera;      // (B, N) that sees each point, in their order
    View<const std::int64_t, 1> tip_camera;  // (B,)
    ConstMatrix reading, tip, tip_covariance, available,
        gravity_m_s2;  // (B, readings), (B, 2), (B, 3), (B, readings), (B, 3)

    int size() const { return usable.shape[0]; }
};

// B frames as they were measured, see `frames_from_pixels` in Python. A camera's points stand next to each other.
struct Pixels {
    ConstCube points;                          // (B, N, 2)
    const double* sigma;                       // of the first point
    std::int64_t sigma_apart, sigma_by_point;  // to the next frame's, and the next point's
    ConstMatrix reading, tip, gravity_m_s2;    // (B, 6), (B, 3), (B, 3)
    View<const std::int64_t, 2> camera;        // (B, N), or none: the rig has one
    View<const std::int64_t, 1> tip_camera;    // (B,)

    int size() const { return points.shape[0]; }
};

Frame frame_of(const Rig& rig, const Frames& frames, int index);
Frame frame_of(const Rig& rig, const Pixels& pixels, int index);

// Sum of one over the points' variances in the ideal picture.
double information_of(const Frame& frame);

// Means of every n neighbouring points of a frame, about `most` of them, and n. Where neighbours lie far apart, one of
// them stands for all.
struct Thinned {
    Frame frame;
    int every;

    // Index of the middle one of the points that a mean stands for.
    int middle(int k, int count) const { return std::min(k * every + every / 2, count - 1); }
};
Thinned thinned(const Frame& frame, int most);

// Destinations of ideal points: u, v and covariance xx, xy, yy.
using IdealColumns = std::array<lens::Column, 5>;

// Ideal points of pixels (N, 2) with standard deviations (N,) across the antenna, and 1 for those that can be used
// (N,); the others, 0, are finite all the same.
void ideal_points(const lens::Lens& lens, ConstMatrix pixels, ConstVector sigma_px, const IdealColumns& to,
                  Vector usable);

// Where points (B, N, 2) lie along the longer side of their frame's, (B, N), unless that is empty; which frames (B,)
// are not in order, and the least and the most of all u and v.
void places(ConstCube points_px, Matrix place, View<bool, 1> disordered, double (&extent)[2][2]);

}  // namespace vbaa::solver
