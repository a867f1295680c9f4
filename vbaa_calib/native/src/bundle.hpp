// Board corners: bundle adjustment of one lens, one board's shape and its pose in each view, and robust homographies.
#pragma once

#include <cstdint>
#include <vector>

#include "arrays.hpp"

namespace vbaa::bundle {

constexpr int SHAPE = 5;  // parameters of a board's shape
constexpr int POSE = 6;   // a rotation vector, rad, and a translation, m

// Corners of V views: board points (N, 3) m, their derivatives by the board's shape (N, 3, 5), pixels (N, 2), weights
// (N,) of their residuals; view v has corners bounds[v] to bounds[v + 1].
struct Corners {
    ConstMatrix points_m;
    ConstCube deformation;
    ConstMatrix pixels;
    ConstVector weights;
    View<const std::int64_t, 1> bounds;

    int views() const { return bounds.shape[0] - 1; }
    int first(int view) const { return static_cast<int>(bounds[view]); }
    int count(int view) const { return static_cast<int>(bounds[view + 1] - bounds[view]); }
    int most() const;  // of a view
};

// Lens (4 + k,), the board's shape (5,), T_camera_board of the views (V, 6).
struct State {
    bool fisheye = false;
    Array<double, 1> lens, shape;
    Array<double, 2> poses;
};

// Priors of the board's shape and penalties on the lens, in addition to the corners.
struct Priors {
    ConstVector mean, std;  // (5,) of the shape: Student's t
    double tail;            // its degrees of freedom
    double noise_px;        // its weight; zero where there is none
    double least_slope;     // of the distorted radius by the ideal one, wherever the picture reaches; zero: none
    double stiffness_px;    // residual of a slope of zero at one of the radii checked
    double width, height;   // of the picture
};

// Termination rules, see `core.least_squares.Rules`.
struct Rules {
    int iterations;
    double tolerance, damping, growth, may_rise_share;
};

// Minimises the cost of corners and priors, starting at and returning `state`; gives the residuals, px, N pairs.
// column (4 + k + 5,): index of the unknown for each number of lens and shape, -1 for fixed ones. robust: by Cauchy's
// loss, which bounds the influence of outliers.
std::vector<double> descend(State& state, const Corners& corners, View<const std::int64_t, 1> column,
                            const Priors& priors, const Rules& rules, bool robust);

// A view's residuals, px, and their negative derivatives by lens, shape and the pose's tangent (a turn in the camera's
// frame, a shift), as rows (4 + k + 5 + 6 + 1, 2 C), the residuals last: C ≥ count u and behind them as many v, zeros
// beyond the view's.
void view_rows(const State& state, const Corners& corners, int view, Matrix rows);

// Residuals (N, 2) and derivatives (N, 2, 4 + k + 5 + 6) of all corners, as `view_rows`.
void corner_rows(const State& state, const Corners& corners, Matrix residuals, Cube slopes);

// Distorted radius at an ideal one (the fisheye's: an angle), its slope, and the slope's derivatives (k,).
void radial_slope(ConstVector distortion, bool fisheye, double radius, double& curve, double& slope,
                  Vector by_distortion);

// Distorted radius of the picture corner farthest from the principal point, plus 2 %; lens (4 + k,).
double corner_radius(ConstVector lens, double width, double height);

// Residuals (m,) px of the radii where the slope is too small, and their negative derivatives (m, 4 + k); returns m.
int unfolding_rows(ConstVector lens, bool fisheye, const Priors& priors, Vector lacking, Matrix by_lens);
constexpr int RADII = 160;  // radii checked

// Cholesky's lower factor of the first rows in place, with reciprocals on its diagonal; false where an unknown is
// determined by the others up to rounding.
bool factored(Matrix matrix, int size);

// Lengths (N,) of corners' residuals (N, 2) over their standard deviations, which are 1 where the view's pose is known:
// less for corners (used) that the pose is solved from, more for the others. slopes (N, 2, 6) by the poses.
void standardised(ConstMatrix residuals, ConstCube slopes, const bool* used, View<const std::int64_t, 1> bounds,
                  Vector lengths);

// Homography (3, 3) of points (N, 2) to their image (N, 2), and the noise per axis as the median corner has it; NaN
// where there is none. Least median of squares (Rousseeuw 1984) over samples of four, picks (S, 4), then least squares
// of the points that it fits. division: λ of the undistortion x / (1 + λr²) of the image.
double homography(ConstMatrix points, ConstMatrix image, View<const std::int64_t, 2> picks, double division,
                  Matrix found);

double median(std::vector<double>& values);  // reorders them; what is not a number counts as infinite

}  // namespace vbaa::bundle
