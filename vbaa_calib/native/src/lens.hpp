// One lens for all: pixels to ideal points and back, with every derivative and validity, for every model.
//
// A model lays directions out on a chart (X/Z, Y/Z; the fisheye: at their angle from the axis), bends the chart onto
// the sensor's normalized plane by a radial gain with decentring and thin prism, tilts the sensor perhaps, and scales
// by the camera matrix. OpenCV's rational model (0, 4, 5, 8, 12 or 14 coefficients) and its fisheye:
// https://docs.opencv.org/4.x/d9/d0c/group__calib3d.html,
// https://docs.opencv.org/4.x/db/d58/group__calib3d__fisheye.html
#pragma once

#include <array>
#include <vector>

#include "arrays.hpp"
#include "lanes.hpp"

namespace vbaa::lens {

// What the map onto the sensor needs, the tilt aside: nothing, a radial gain, or decentring and prism, too.
enum class Path { none, radial, full };

// The ideal radius r at even steps of ρ/(1 + ρ), over the branch on which the distorted radius ρ grows.
struct RadialTable {
    std::vector<double> nodes = {0.0, 0.0};  // r at each node
    std::vector<double> steps = {0.0, 0.0};  // from it to the next
    double nodes_per_unit = 0.0;             // nodes for each unit of ρ/(1 + ρ)
    double ideal_limit = 0.0;                // where the branch ends
    double distorted_limit = 0.0;            // the same of ρ
};

// A closed curve around the axis: a radius in each of evenly spaced directions from −π on, the first one again last.
struct Rim {
    std::vector<double> radii;
    double inner = 0.0;  // the smallest of them
};

// A lens, its camera matrix, and how far it may be trusted.
struct Lens {
    bool fisheye = false, tilted = false;
    Path path = Path::none;
    double fx = 1.0, fy = 1.0, cx = 0.0, cy = 0.0;
    std::array<double, 14> coefficients = {};  // k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 τx τy, or the fisheye's k1 to k4
    int distortions = 0;                       // how many of them the model has
    RadialTable table;                         // unless nothing is distorted
    Rim ideal, reach;  // full: rim of the trusted region, and one around everything that it is distorted to
    double ideal_limit = 0.0, distorted_limit = 0.0;  // largest radii trusted in every direction; may be infinite

    int parameters() const { return 4 + distortions; }
};

// A lens made ready; matrix (4,) fx, fy, cx, cy, coefficients (k,).
Lens prepared(bool fisheye, ConstVector matrix, ConstVector coefficients);

// X/Z, Y/Z (N, 2) of pixels (N, 2), d(X/Z, Y/Z)/d(u, v) (N, 4) row by row, and validity (N,); anything finite or not
// where not valid.
void normalized_of_pixels(const Lens& lens, ConstMatrix pixels, Matrix points, Matrix slopes, bool* valid);

// d(X/Z, Y/Z)/d(fx, fy, cx, cy, *distortion), columns (2, 4 + k, LANES), of LANES fixed pixels; zeros where one is not
// seen. seen: X/Z and Y/Z in the first two rows, then scratch room; the third says 1 where the point is seen, 0 else.
void normalized_by_lens(const Lens& lens, double (&seen)[6][LANES], Cube columns);

// Whether an ideal point of the chart lies in the region, connected to the axis, where the lens is one to one.
bool sees(const Lens& lens, double x, double y);

// Pixels (N, 2) of points (N, 3) that a pose carries into the camera's frame, and validity (N,).
void pixels_of_points(const Lens& lens, ConstMatrix rotation, ConstVector translation_m, ConstMatrix points_m,
                      Matrix pixels, bool* valid);

}  // namespace vbaa::lens
