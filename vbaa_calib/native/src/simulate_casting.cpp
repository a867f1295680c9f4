#include "simulate_casting.hpp"

#include <algorithm>
#include <cmath>

namespace vbaa::simulate {

namespace {

constexpr int STEPS = 100;
constexpr double HIT_M = 1e-6;

struct Hit {
    double depth = INFINITE;
    Point normal = {};
    int face = -1;
};

struct Interval {
    double first, last;
};

// The interval of t in which a ray is inside a convex quadric, a·t² + 2·half_b·t + c < 0; (∞, −∞) when it passes by.
Interval quadric(double a, double half_b, double c) {
    double root = half_b * half_b - a * c;
    if (root < 0.0 || a <= 0.0) return {INFINITE, -INFINITE};
    return {(-half_b - std::sqrt(root)) / a, (-half_b + std::sqrt(root)) / a};
}

Point side_of(const Body& body, int k) { return read<Point>(&body.sides(k, 0)); }

// First hit of a ray on a convex body: behind all of its planes and inside its quadric.
Hit meet(const Body& body, const Point& start, const Point& ray) {
    Interval inside = {-INFINITE, INFINITE};
    int face = 0, round_sides = 0;
    Point across = ray, offset = start;
    double radius = body.object.radius_m;
    if (body.object.kind != KNIFE) {
        across = body.across.turned(ray);
        offset = body.across.turned(start);
        inside = quadric(dot(across, across), dot(across, offset), dot(offset, offset) - radius * radius);
        round_sides = 1;
    }
    for (int k = 0; k < body.sides.shape[0]; ++k) {
        double speed = dot(side_of(body, k), ray);
        if (std::abs(speed) < 1e-12) speed = 1e-12;
        double crossed = (body.sides(k, 3) - dot(side_of(body, k), start)) / speed;
        if (speed > 0.0) {
            inside.last = std::min(inside.last, crossed);
        } else if (crossed > inside.first) {
            inside.first = crossed;
            face = k + round_sides;
        }
    }
    if (!(0.0 < inside.first && inside.first < inside.last)) return {};
    if (face < round_sides) return {inside.first, 1.0 / radius * (offset + inside.first * across), face};
    return {inside.first, side_of(body, face - round_sides), face};
}

// Safe step of sphere tracing from a point, as depth, with normal and face of the nearest surface.
Hit room_at(const Body& body, const Point& offset) {
    if (body.object.kind == FREEFORM) {
        auto [value, slope] = elevation(offset, body.object.radius_m, body.object.bumps);
        return {value / body.steepest, unit(slope), 0};
    }
    auto [room, normal] = signed_distance(body.object, offset + body.object.center_m);
    Hit found = {room, normal, 0};
    for (int k = 0; k < body.sides.shape[0]; ++k) {
        double away = dot(side_of(body, k), offset) - body.sides(k, 3);
        if (away > found.depth) found = {away, side_of(body, k), k + 1};
    }
    return found;
}

// Hit of a ray on a body with a known distance function, by sphere tracing.
Hit march(const Body& body, const Point& start, const Point& ray) {
    double length = norm(ray), reach = 1.01 * body.reach_m;
    Point way = 1.0 / length * ray;
    auto [enter, leave] = quadric(1.0, dot(way, start), dot(start, start) - reach * reach);
    double depth = std::max(enter, 0.0);
    for (int step = 0; step < STEPS && depth < leave; ++step) {
        Hit here = room_at(body, start + depth * way);
        if (here.depth < HIT_M) return {depth / length, here.normal, here.face};
        depth += here.depth;
    }
    return {};
}

Hit first_hit(const Body& body, const Point& start, const Point& ray) {
    const bool marched = body.object.kind == BOX || body.object.kind == FREEFORM;
    return marched ? march(body, start, ray) : meet(body, start, ray);
}

}  // namespace

Hits cast_rays(const Body& body, const Point& origin_m, ConstMatrix directions) {
    int count = directions.shape[0];
    Hits hits = {Array<double, 1>(count), Array<double, 2>(count, 3), Array<std::int64_t, 1>(count)};
    Point start = origin_m - body.object.center_m;
    for (int i = 0; i < count; ++i) {
        const Hit hit = first_hit(body, start, read<Point>(&directions(i, 0)));
        hits.depths[i] = hit.depth;
        hits.faces[i] = hit.face;
        write(hit.normal, &hits.normals(i, 0));
    }
    return hits;
}

Lit lit(const Body& body, const Point& origin_m, const Rotation& turn, ConstMatrix rays, const Light& light) {
    const int count = rays.shape[0];
    Lit found = {Array<double, 1>(Unset{}, count), Array<std::int8_t, 1>(Unset{}, count)};
    const Point start = origin_m - body.object.center_m;
    for (int i = 0; i < count; ++i) {
        const Point ray = turn.turned(Point{rays(i, 0), rays(i, 1), 1.0});
        const Hit hit = first_hit(body, start, ray);
        found.faces[i] = static_cast<std::int8_t>(hit.face);
        found.brightness[i] = 0.0;
        if (hit.face < 0) continue;
        const Point point = start + hit.depth * ray;
        double stains = std::sin(dot(point, Point{310.0, 120.0, -90.0}));
        stains += std::sin(dot(point, Point{-70.0, 210.0, 260.0}) + 1.0);
        const double arriving = light.ambient + (1.0 - light.ambient) * std::max(dot(hit.normal, light.lamp), 0.0);
        found.brightness[i] = arriving * (1.0 + 0.04 * stains);
    }
    return found;
}

}  // namespace vbaa::simulate
