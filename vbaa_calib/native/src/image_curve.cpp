// Feet of detected points on cubic Hermite curves, and their distances over standard deviations.
#include "image_curve.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace vbaa::lens {
namespace {

constexpr int FOOT_STEPS = 2;

struct OnCurve {
    double point[2], along[2];
};

OnCurve at(const ImageCurve& curve, double s) {
    const ConstVector& nodes_s = curve.arclength_m;
    const int count = nodes_s.shape[0];
    const int right = static_cast<int>(std::upper_bound(nodes_s.begin(), nodes_s.end(), s) - nodes_s.begin());
    const int left = std::clamp(right - 1, 0, count - 2);
    const double span = nodes_s[left + 1] - nodes_s[left], t = (s - nodes_s[left]) / span;
    OnCurve found;
    for (int axis = 0; axis < 2; ++axis) {
        const double p0 = curve.nodes(left, axis), p1 = curve.nodes(left + 1, axis);
        const double d0 = span * curve.slopes(left, axis), d1 = span * curve.slopes(left + 1, axis);
        const double a = 2.0 * (p0 - p1) + d0 + d1, b = 3.0 * (p1 - p0) - 2.0 * d0 - d1;
        found.point[axis] = ((a * t + b) * t + d0) * t + p0;
        found.along[axis] = ((3.0 * a * t + 2.0 * b) * t + d0) / span;
    }
    return found;
}

}  // namespace

void interpolate(const ImageCurve& curve, ConstVector arclength_m, Matrix points, Matrix along) {
    for (int n = 0; n < arclength_m.shape[0]; ++n) {
        const OnCurve found = at(curve, arclength_m[n]);
        for (int axis = 0; axis < 2; ++axis) points(n, axis) = found.point[axis], along(n, axis) = found.along[axis];
    }
}

void feet(const ImageCurve& curve, ConstMatrix points, Vector arclength_m) {
    const int count = curve.arclength_m.shape[0];
    for (int n = 0; n < points.shape[0]; ++n) {
        const double u = points(n, 0), v = points(n, 1);
        int nearest = 0;
        double least = std::numeric_limits<double>::infinity();
        for (int i = 0; i < count; ++i) {
            const double x = curve.nodes(i, 0) - u, y = curve.nodes(i, 1) - v;
            if (x * x + y * y < least) nearest = i, least = x * x + y * y;
        }
        double s = curve.arclength_m[nearest];
        for (int step = 0; step < FOOT_STEPS; ++step) {
            const auto [point, along] = at(curve, s);
            s += ((u - point[0]) * along[0] + (v - point[1]) * along[1]) / (along[0] * along[0] + along[1] * along[1]);
            s = std::min(std::max(s, curve.arclength_m[0]), curve.arclength_m[count - 1]);
        }
        arclength_m[n] = s;
    }
}

void whitened(ConstMatrix points, ConstCube covariance, const ImageCurves& curves, Matrix residuals, Matrix normals) {
    const int count = points.shape[0];
    const ImageCurve first = curves[0];
    Array<double, 1> foot(count);
    feet(first, points, foot);
    for (int n = 0; n < count; ++n) {
        const OnCurve found = at(first, foot[n]);
        const double x = found.along[0], y = found.along[1], shear = covariance(n, 0, 1) + covariance(n, 1, 0);
        const double deviation = std::sqrt(covariance(n, 0, 0) * y * y - shear * x * y + covariance(n, 1, 1) * x * x);
        normals(n, 0) = -y / deviation, normals(n, 1) = x / deviation;
        for (int k = 0; k < curves.nodes.shape[0]; ++k) {
            const OnCurve own = at(curves[k], foot[n]);
            residuals(n, k) =
                (points(n, 0) - own.point[0]) * normals(n, 0) + (points(n, 1) - own.point[1]) * normals(n, 1);
        }
    }
}

}  // namespace vbaa::lens
