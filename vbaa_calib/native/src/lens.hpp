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

// Parts of the map onto the sensor, apart from the tilt: none, a radial gain, or decentring and prism, too.
enum class Path { none, radial, full };

// A model with its numbers; all that the maps need (lens_maps.hpp).
struct Model {
    bool fisheye = false;
    Path path = Path::none;
    bool rational = false, tilted = false;  // with a denominator; with the coefficients of a tilted sensor
    double fx = 1.0, fy = 1.0, cx = 0.0, cy = 0.0;
    std::array<double, 14> coefficients = {};  // k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 τx τy, or the fisheye's k1 to k4
    int distortions = 0;                       // how many of them the model has
    std::array<double, 9> turn = {};           // of the tilted sensor, a rotation matrix

    int parameters() const { return 4 + distortions; }
};

// The model of parameters (4 + k,): fx, fy, cx, cy and coefficients.
Model model_of(bool fisheye, ConstVector parameters);

// The ideal radius r at even steps of ρ/(1 + ρ), over the branch on which the distorted radius ρ grows.
struct RadialTable {
    std::vector<double> nodes = {0.0, 0.0};  // r at each node
    std::vector<double> steps = {0.0, 0.0};  // from it to the next
    double nodes_per_unit = 0.0;             // nodes for each unit of ρ/(1 + ρ)
    double ideal_limit = 0.0;                // where the branch ends
    double distorted_limit = 0.0;            // the same of ρ

    // The node at or before a place; the last one for NaN and for places beyond the table.
    template <class T>
    int node(T place) const {
        const int last = static_cast<int>(nodes.size()) - 1;
        return place < static_cast<T>(last) ? static_cast<int>(place) : last;
    }
};

// A closed curve around the axis: a radius in each of evenly spaced directions from −π on, the first one again last.
struct Rim {
    std::vector<double> radii;
    double inner = 0.0;  // the smallest of them

    bool encloses(double x, double y) const;
};

// A model made ready: how far it may be trusted, and where a search for the way back starts.
//
// With decentring or prism it is trusted direction by direction: the symmetric part of the Jacobian is positive
// definite from the axis to the rim. Without prism the Jacobian is symmetric, so the rim is where its determinant first
// reaches zero, the fold. The region is convex (where the folds leave it notched, the largest disc inside is taken),
// and on a convex region the map is then one to one: (F(a) − F(b))·(a − b) > 0 for any two of its points.
struct Lens : Model {
    RadialTable table;                                // unless nothing is distorted
    Rim ideal, reach;                                 // full: rim of the region, and one around all it is distorted to
    double ideal_limit = 0.0, distorted_limit = 0.0;  // largest radii trusted in every direction; may be infinite
};

Lens prepared(bool fisheye, ConstVector parameters);

// Whether an ideal point of the chart lies in the region, connected to the axis, where the lens is one to one.
bool sees(const Lens& lens, double x, double y);

// An ideal point (x, y) of a distorted one on an untilted sensor that a few Newton steps did not find; false where
// there is none. On entry (x, y) is the end of those steps.
bool searched(const Lens& lens, double distorted_x, double distorted_y, double& x, double& y);

// Pixels (N, 2) of points (N, 3) in the camera's frame and validity (N,); NaN where not valid. Where asked for (not
// empty), d(u, v)/d(point) (N, 2, 3) and d(u, v)/d(fx, fy, cx, cy, *distortion) (N, 2, 4 + k); zeros where not valid.
void project(const Lens& lens, ConstMatrix points, Matrix pixels, bool* valid, Cube by_point, Cube by_lens);

// Points (N, 2) on the model's chart of pixels (N, 2) and validity (N,); NaN where not valid.
void chart_of_pixels(const Lens& lens, ConstMatrix pixels, Matrix points, bool* valid);

// Unit rays (N, 3) of pixels (N, 2) and validity (N,); NaN where not valid.
void rays_of_pixels(const Lens& lens, ConstMatrix pixels, Matrix rays, bool* valid);

// The same with derivatives: d(ray)/d(u, v) (N, 3, 2), d(ray)/d(fx, fy, cx, cy, *distortion) for a fixed pixel (N, 3,
// 4 + k).
void rays_with_slopes(const Lens& lens, ConstMatrix pixels, Matrix rays, Cube by_pixel, Cube by_lens, bool* valid);

// Destination of one number per pixel: the first place, and the stride.
struct Column {
    double* first = nullptr;
    int apart = 1;
};
// Destinations of X/Z and Y/Z and, if set, of d(X/Z, Y/Z)/d(u, v) row by row.
struct Normalized {
    Column x, y, slopes[4];
};

// X/Z, Y/Z of pixels (N, 2), perhaps with slopes, and validity (N,); NaN where not valid.
void normalized_of_pixels(const Lens& lens, ConstMatrix pixels, const Normalized& to, bool* valid);

// d(X/Z, Y/Z)/d(fx, fy, cx, cy, *distortion), columns (2, 4 + k, LANES), of LANES fixed pixels; zeros where one is not
// seen. seen: X/Z and Y/Z in the first two rows, then scratch room; the third says 1 where the point is seen, 0 else.
void normalized_by_lens(const Lens& lens, double (&seen)[6][LANES], Cube columns);

// The same of points (N, 2): slopes (N, 2, 4 + k), NaN where not seen.
void normalized_by_lens(const Lens& lens, ConstMatrix points, Cube slopes);

// A plane normal·x = offset that a camera sees, and axes (2 or 3, 3) of the coordinates wanted on it.
struct Plane {
    ConstMatrix rotation;  // (3, 3) and (3,) the camera's pose in the plane's frame, m
    ConstVector translation_m;
    ConstVector normal;  // (3,)
    double offset_m = 0.0;
    ConstMatrix axes;
};

// Coordinates (N, 2 or 3) m of the points where the rays of pixels (N, 2) meet a plane, and validity (N,); NaN where
// not valid: no ray, grazing, behind the camera, a plane through its centre. Pixels in single precision are
// worked on in that, except through lenses with denominators that lose digits.
void plane_of_pixels(const Lens& lens, const Plane& plane, ConstMatrix pixels, Matrix points, bool* valid);
void plane_of_pixels(const Lens& lens, const Plane& plane, View<const float, 2> pixels, View<float, 2> points,
                     bool* valid);

// Their derivatives (N, 2 or 3, P), NaN where not valid: by the pixel (P = 2), or by the lens' parameters, then a turn
// (rotation vector, rad) and a shift (m) of the camera in the plane's frame (P = 4 + k + 6).
void plane_by_pixel(const Lens& lens, const Plane& plane, ConstMatrix pixels, Cube slopes);
void plane_by_calibration(const Lens& lens, const Plane& plane, ConstMatrix pixels, Cube slopes);

}  // namespace vbaa::lens
