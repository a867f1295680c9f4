#include "simulate_objects.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "newton.hpp"

namespace vbaa::simulate {

namespace {

constexpr int ITERATIONS = 30, RADIUS_ITERATIONS = 6;
constexpr double TOLERANCE = 1e-14;

struct Bump {
    Point direction;
    double height_m, width_m;
};

Bump bump_of(ConstMatrix bumps, int k) { return read<Bump>(&bumps(k, 0)); }

// Surface at a radius around the core, by the offset from the core's nearest point.
Surface grown(const Point& offset, double radius_m) {
    double away = norm(offset);
    return {away - radius_m, (away > 1e-15 ? 1.0 / away : std::numeric_limits<double>::quiet_NaN()) * offset};
}

Surface from_box(const Point& offset, const Point& one, const Point& other, double radius_m) {
    double depth = dot(offset, one), deep = dot(offset, other);
    // inside the core the nearer face counts
    if (depth > 0.0 && deep > 0.0) return {-std::min(depth, deep) - radius_m, depth <= deep ? -one : -other};
    return grown(std::min(depth, 0.0) * one + std::min(deep, 0.0) * other, radius_m);
}

// Distance from any object but a free form.
[[gnu::always_inline]] inline Surface from_core(const Object& object, Point offset) {
    if (object.kind == BOX) return from_box(offset, object.into_faces[0], object.into_faces[1], object.radius_m);
    if (object.kind == CYLINDER || object.kind == KNIFE) offset = offset - dot(offset, object.axis) * object.axis;
    if (object.kind == KNIFE) offset = offset - std::max(dot(offset, object.wedge), 0.0) * object.wedge;
    return grown(offset, object.radius_m);
}

// F's second derivatives at a point from the centre, in the upper left.
Small<4, 4> curvature(const Point& point_m, double radius_m, ConstMatrix bumps) {
    Small<4, 4> bend = {};
    auto add = [&](double factor, const Point& along, double diagonal) {
        const double v[] = {along.x, along.y, along.z};
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) bend[i][j] += factor * v[i] * v[j];
            bend[i][i] += diagonal;
        }
    };
    double away = norm(point_m);
    add(-1.0 / (away * away * away), point_m, 1.0 / away);
    for (int k = 0; k < bumps.shape[0]; ++k) {
        Bump bump = bump_of(bumps, k);
        Point offset = point_m - radius_m * bump.direction;
        double square = bump.width_m * bump.width_m;
        double rate = bump.height_m * std::exp(-0.5 * dot(offset, offset) / square) / square;
        add(-rate / square, offset, rate);
    }
    return bend;
}

double surface_radius(const Point& direction, double radius_m, ConstMatrix bumps) {
    double radius = radius_m;
    for (int iteration = 0; iteration < RADIUS_ITERATIONS; ++iteration) {
        auto [value, slope] = elevation(radius * direction, radius_m, bumps);
        radius -= value / dot(slope, direction);
    }
    return radius;
}

// By Newton's method on the nearest point and its multiplier.
Surface from_freeform(const Point& point_m, double radius_m, ConstMatrix bumps) {
    double away = norm(point_m);
    Point outward = 1.0 / away * point_m;
    // the surface along the point's direction from the centre, and the multiplier that belongs to it
    double radius = surface_radius(outward, radius_m, bumps), share = away - radius;
    Point foot = radius * outward;
    for (int iteration = 0; iteration < ITERATIONS; ++iteration) {
        auto [value, slope] = elevation(foot, radius_m, bumps);
        Point off = foot + share * slope - point_m;
        if (largest(Numbers<4>{off.x, off.y, off.z, value}) <= TOLERANCE) {
            double steep = norm(slope);
            return {share * steep, 1.0 / steep * slope};
        }
        Small<4, 4> matrix = curvature(foot, radius_m, bumps);
        const double slopes[] = {slope.x, slope.y, slope.z};
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) matrix[i][j] = share * matrix[i][j] + (i == j ? 1.0 : 0.0);
            matrix[i][3] = matrix[3][i] = slopes[i];
        }
        Small<4, 1> left = {{{-off.x}, {-off.y}, {-off.z}, {-value}}};
        if (!solve<4, 1>(matrix, left)) break;
        foot = foot + Point{left[0][0], left[1][0], left[2][0]};
        share += left[3][0];
    }
    auto [value, slope] = elevation(point_m, radius_m, bumps);
    double steep = norm(slope);
    return {value / steep, 1.0 / steep * slope};
}

double rough_distance(const Object& object, const Point& point_m) {
    if (object.kind == FREEFORM) return elevation(point_m - object.center_m, object.radius_m, object.bumps).value;
    return from_core(object, point_m - object.center_m).distance_m;
}

[[gnu::always_inline]] inline Surface nearest(const Object& object, const Point& point_m) {
    Point offset = point_m - object.center_m;
    return object.kind == FREEFORM ? from_freeform(offset, object.radius_m, object.bumps) : from_core(object, offset);
}

// Applies `of_point`, which gives distance or value and normal or slope, to points (K, 3).
template <class OfPoint>
Surfaces of_each(ConstMatrix points_m, OfPoint of_point) {
    int count = points_m.shape[0];
    Surfaces found = {Array<double, 1>(count), Array<double, 2>(count, 3)};
    for (int i = 0; i < count; ++i) {
        auto [value, along] = of_point(read<Point>(&points_m(i, 0)));
        found.distances_m[i] = value;
        write(along, found.normals.values.data() + 3 * i);
    }
    return found;
}

}  // namespace

Surface signed_distance(const Object& object, const Point& point_m) { return nearest(object, point_m); }
Elevation elevation(const Point& point_m, double radius_m, ConstMatrix bumps) {
    double away = norm(point_m);
    Elevation found = {away - radius_m, 1.0 / away * point_m};
    for (int k = 0; k < bumps.shape[0]; ++k) {
        Bump bump = bump_of(bumps, k);
        Point offset = point_m - radius_m * bump.direction;
        double square = bump.width_m * bump.width_m;
        double lift = bump.height_m * std::exp(-0.5 * dot(offset, offset) / square);
        found.value -= lift;
        found.slope = found.slope + lift / square * offset;
    }
    return found;
}

Surfaces signed_distances(const Object& object, ConstMatrix points_m) {
    return of_each(points_m, [object](const Point& point) { return nearest(object, point); });
}

Array<double, 1> rough_distances(const Object& object, ConstMatrix points_m) {
    Array<double, 1> found(points_m.shape[0]);
    // a local copy, so that the compiler knows that it does not change
    const Object copy = object;
    for (int i = 0; i < points_m.shape[0]; ++i) found[i] = rough_distance(copy, read<Point>(&points_m(i, 0)));
    return found;
}

Surfaces elevations(ConstMatrix points_m, double radius_m, ConstMatrix bumps) {
    return of_each(points_m, [&](const Point& point) { return elevation(point, radius_m, bumps); });
}

Array<double, 1> surface_radii(ConstMatrix directions, double radius_m, ConstMatrix bumps) {
    Array<double, 1> found(directions.shape[0]);
    for (int i = 0; i < found.size(); ++i) found[i] = surface_radius(read<Point>(&directions(i, 0)), radius_m, bumps);
    return found;
}

int first_within(const Object& object, ConstCube rotations, ConstMatrix origins_m, ConstMatrix points_m,
                 ConstVector room_m) {
    // F grows no faster than this: where it is larger, nothing needs to be searched
    double steepest = 1.0;
    for (int k = 0; k < object.bumps.shape[0]; ++k) {
        Bump bump = bump_of(object.bumps, k);
        steepest += std::abs(bump.height_m) / bump.width_m;
    }
    const int count = points_m.shape[0];
    double room = 0.0, apart = 0.0;  // the largest room, and distance of a point from the next
    for (int n = 0; n < count; ++n) {
        room = std::max(room, room_m[n]);
        if (n > 0) apart = std::max(apart, norm(read<Point>(&points_m(n, 0)) - read<Point>(&points_m(n - 1, 0))));
    }
    for (int i = 0; i < rotations.shape[0]; ++i) {
        Rotation rotation = read<Rotation>(&rotations(i, 0, 0));
        Point origin = read<Point>(&origins_m(i, 0));
        for (int n = 0; n < count;) {
            Point point = rotation.turned(read<Point>(&points_m(n, 0))) + origin;
            double away = 0.0;
            if (object.kind == FREEFORM) away = rough_distance(object, point) / steepest;
            if (away <= room_m[n]) away = signed_distance(object, point).distance_m;
            if (away < room_m[n]) return i;
            // no nearer to the object than that, less the way to them, are the next ones
            n += away > room + apart ? static_cast<int>(std::min((away - room) / apart, 1.0 * count)) : 1;
        }
    }
    return rotations.shape[0];
}

}  // namespace vbaa::simulate
