// A board's corners through a lens: pixels and their derivatives by lens, board's shape and view's pose, eight corners
// at once; and the slope of the lens' radial curve.
#include <algorithm>
#include <cmath>

#include "bundle.hpp"
#include "lens_maps.hpp"

namespace vbaa::bundle {
namespace {

constexpr double POLE_GUARD = 1e-3, BEYOND_CORNER = 1.02;

// (3, 3) of a rotation vector.
void rotation_matrix(const double* turn, double (&r)[3][3]) {
    const double angle = std::sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]);
    const double share = angle > 1e-8 ? std::sin(0.5 * angle) / angle : 0.5;
    const double w = std::cos(0.5 * angle), q[3] = {share * turn[0], share * turn[1], share * turn[2]};
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        r[i][i] = 1.0 - 2.0 * (q[j] * q[j] + q[k] * q[k]);
        r[i][j] = 2.0 * (q[i] * q[j] - w * q[k]);
        r[j][i] = 2.0 * (q[i] * q[j] + w * q[k]);
    }
}

// Eight corners of a view from `first` on, the last one again where there are fewer.
struct EightCorners {
    Lanes point[3], pixel[2], deformation[3][SHAPE];

    EightCorners(const Corners& corners, int first, int some) {
        for (int lane = 0; lane < LANES; ++lane) {
            const int n = first + std::min(lane, some - 1);
            for (int axis = 0; axis < 2; ++axis) pixel[axis][lane] = corners.pixels(n, axis);
            for (int axis = 0; axis < 3; ++axis) {
                point[axis][lane] = corners.points_m(n, axis);
                for (int i = 0; i < SHAPE; ++i) deformation[axis][i][lane] = corners.deformation(n, axis, i);
            }
        }
    }
};

}  // namespace

int Corners::most() const {
    int found = 0;
    for (int view = 0; view < views(); ++view) found = std::max(found, count(view));
    return found;
}

void view_rows(const State& state, const Corners& corners, int view, Matrix rows) {
    const lens::Model model = lens::model_of(state.fisheye, state.lens);
    const int count = corners.count(view), half = rows.shape[1] / 2, size = model.parameters();
    const double* pose = state.poses.row(view).data;
    double r[3][3];
    rotation_matrix(pose, r);
    const Lanes zero = {};
    for (int n = 0; n < half; n += LANES) {
        const auto put = [&](int row, Lanes u, Lanes v) {
            if (n + LANES > count) {
                const int some = std::max(count - n, 0);
                for (int lane = some; lane < LANES; ++lane) u[lane] = v[lane] = 0.0;
            }
            store(&rows(row, n), u), store(&rows(row, half + n), v);
        };
        if (n >= count) {
            for (int row = 0; row < rows.shape[0]; ++row) put(row, zero, zero);
            continue;
        }
        EightCorners at(corners, corners.first(view) + n, std::min(LANES, count - n));
        Lanes turned[3], place[3];
        for (int axis = 0; axis < 3; ++axis)
            for (int i = 0; i < SHAPE; ++i) at.point[axis] += at.deformation[axis][i] * state.shape[i];
        for (int axis = 0; axis < 3; ++axis) {
            turned[axis] = r[axis][0] * at.point[0] + r[axis][1] * at.point[1] + r[axis][2] * at.point[2];
            place[axis] = turned[axis] + pose[3 + axis];
        }
        place[2] = choose(place[2] == zero, spread(1.0), place[2]);
        const lens::Layout<Lanes> to = lens::chart_of_point(state.fisheye, place[0], place[1], place[2]);
        const Lanes x = place[0] * to.ratio, y = place[1] * to.ratio, shear = to.xy(place[0], place[1]);
        const lens::Sensed<Lanes> seen = lens::on_sensor(model, x, y);
        put(0, seen.x, zero), put(1, zero, seen.y), put(2, spread(1.0), zero), put(3, zero, spread(1.0));
        lens::by_coefficients(model, x, y, seen,
                              [&](int i, Lanes dx, Lanes dy) { put(4 + i, model.fx * dx, model.fy * dy); });
        const Lanes off_u = at.pixel[0] - (model.fx * seen.x + model.cx);
        put(size + SHAPE + POSE, off_u, at.pixel[1] - (model.fy * seen.y + model.cy));
        const Lanes columns[3][2] = {
            {to.xx(place[0]), shear}, {shear, to.xx(place[1])}, {-place[0] * to.drop, -place[1] * to.drop}};
        Lanes by[2][3], by_board[2][3];  // of u and v, by the point in the camera's and in the board's frame
        for (int k = 0; k < 3; ++k) {
            by[0][k] = model.fx * (seen.xx * columns[k][0] + seen.xy * columns[k][1]);
            by[1][k] = model.fy * (seen.yx * columns[k][0] + seen.yy * columns[k][1]);
        }
        for (int axis = 0; axis < 2; ++axis)
            for (int k = 0; k < 3; ++k)
                by_board[axis][k] = by[axis][0] * r[0][k] + by[axis][1] * r[1][k] + by[axis][2] * r[2][k];
        for (int i = 0; i < SHAPE; ++i) {
            const auto& d = at.deformation;
            const auto moved = [&](const Lanes(&g)[3]) { return g[0] * d[0][i] + g[1] * d[1][i] + g[2] * d[2][i]; };
            put(size + i, moved(by_board[0]), moved(by_board[1]));
        }
        for (int k = 0; k < 3; ++k) {  // gᵀ(ω × q) = ωᵀ(q × g)
            const int i = (k + 1) % 3, j = (k + 2) % 3;
            put(size + SHAPE + k, turned[i] * by[0][j] - turned[j] * by[0][i],
                turned[i] * by[1][j] - turned[j] * by[1][i]);
            put(size + SHAPE + 3 + k, by[0][k], by[1][k]);
        }
    }
}

void corner_rows(const State& state, const Corners& corners, Matrix residuals, Cube slopes) {
    const int width = state.lens.size() + SHAPE + POSE, half = whole_lanes(corners.most());
    Array<double, 2> rows(width + 1, 2 * half);
    for (int view = 0; view < corners.views(); ++view) {
        view_rows(state, corners, view, rows);
        for (int n = 0; n < corners.count(view); ++n)
            for (int axis = 0; axis < 2; ++axis) {
                const int at = corners.first(view) + n;
                residuals(at, axis) = rows(width, axis * half + n);
                for (int i = 0; i < width; ++i) slopes(at, axis, i) = rows(i, axis * half + n);
            }
    }
}

void radial_slope(ConstVector distortion, bool fisheye, double radius, double& curve, double& slope,
                  Vector by_distortion) {
    const double square = radius * radius;
    const int count = distortion.shape[0], terms = fisheye ? 4 : 3;
    const auto place = [&](int i) { return fisheye || i < 2 ? i : 4; };
    const bool rational = !fisheye && count > 5;
    double top = 1.0, by_top = 0.0, bottom = 1.0, by_bottom = 0.0, power = 1.0;  // by the radius' logarithm
    for (int i = 0; i < terms; ++i) {
        power *= square;
        if (place(i) < count) {
            top += distortion[place(i)] * power, by_top += 2 * (i + 1) * distortion[place(i)] * power;
        }
        if (rational) bottom += distortion[5 + i] * power, by_bottom += 2 * (i + 1) * distortion[5 + i] * power;
    }
    if (std::abs(bottom) < POLE_GUARD) bottom = POLE_GUARD;
    const double ratio = top / bottom, turning = (by_top - ratio * by_bottom) / bottom;
    fill(by_distortion, 0.0);
    power = 1.0;
    for (int i = 0; i < terms; ++i) {
        power *= square;
        if (place(i) < count) by_distortion[place(i)] = (2 * i + 3 - by_bottom / bottom) * power / bottom;
        const double own = (2 * i + 3) * ratio + turning - ratio * by_bottom / bottom;
        if (rational) by_distortion[5 + i] = -own * power / bottom;
    }
    curve = radius * ratio, slope = ratio + turning;
}

double corner_radius(ConstVector lens, double width, double height) {
    const double far_x = std::max(width - 0.5 - lens[2], lens[2] + 0.5);
    const double far_y = std::max(height - 0.5 - lens[3], lens[3] + 0.5);
    return BEYOND_CORNER * std::hypot(far_x / lens[0], far_y / lens[1]);
}

}  // namespace vbaa::bundle
