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

// Hits of eight rays; depths are infinite and faces −1 where they miss.
struct Eight {
    Lanes depth;
    Vectors normal;
    Lanes face;
};

// The interval of t in which rays are inside a convex quadric, a·t² + 2·half_b·t + c < 0; (∞, −∞) when they pass by.
struct Interval {
    Lanes first, last;
};
Interval quadric(const Lanes& a, const Lanes& half_b, const Lanes& c) {
    const Lanes root = half_b * half_b - a * c;
    const auto meets = (root >= 0.0) & (a > 0.0);
    const Lanes span = sqrt(choose(meets, root, 0.0));
    return {choose(meets, (-half_b - span) / a, INFINITE), choose(meets, (-half_b + span) / a, -INFINITE)};
}

Point side_of(const Body& body, int k) { return read<Point>(&body.sides(k, 0)); }

// First hits of rays on a convex body: behind all of its planes and inside its quadric.
Eight meet(const Body& body, const Point& start, const Vectors& rays) {
    Interval inside = {-INFINITE, INFINITE};
    Eight found = {INFINITE, {0.0, 0.0, 0.0}, 0.0};
    const int round_sides = body.object.kind != KNIFE;
    Vectors across = rays;
    const Point offset = body.across.turned(start);
    const double radius = body.object.radius_m;
    if (round_sides) {
        across = body.across.turned(rays);
        inside = quadric(dot(across, across), dot(across, offset), spread(dot(offset, offset) - radius * radius));
    }
    for (int k = 0; k < body.sides.shape[0]; ++k) {
        Lanes speed = dot(side_of(body, k), rays);
        speed = choose(absolute(speed) < 1e-12, 1e-12, speed);
        const Lanes crossed = (body.sides(k, 3) - dot(side_of(body, k), start)) / speed;
        const auto outwards = speed > 0.0;
        inside.last = choose(outwards & (crossed < inside.last), crossed, inside.last);
        const auto later = ~outwards & (crossed > inside.first);
        inside.first = choose(later, crossed, inside.first);
        found.face = choose(later, k + round_sides, found.face);
    }
    const auto hit = (inside.first > 0.0) & (inside.first < inside.last);
    found.depth = choose(hit, inside.first, INFINITE);
    found.face = choose(hit, found.face, -1.0);
    const auto facing = [&](int face, const Vectors& normal) {
        const auto own = found.face == face;
        found.normal = {choose(own, normal.x, found.normal.x), choose(own, normal.y, found.normal.y),
                        choose(own, normal.z, found.normal.z)};
    };
    if (round_sides) facing(0, 1.0 / radius * (offset + inside.first * across));
    for (int k = 0; k < body.sides.shape[0]; ++k) {
        const Point side = side_of(body, k);
        facing(k + round_sides, {side.x, side.y, side.z});
    }
    return found;
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
    const double closest = dot(way, start), root = closest * closest - dot(start, start) + reach * reach;
    if (root < 0.0) return {};
    const double leave = -closest + std::sqrt(root);
    double depth = std::max(-closest - std::sqrt(root), 0.0);
    for (int step = 0; step < STEPS && depth < leave; ++step) {
        Hit here = room_at(body, start + depth * way);
        if (here.depth < HIT_M) return {depth / length, here.normal, here.face};
        depth += here.depth;
    }
    return {};
}

Eight first_hits(const Body& body, const Point& start, const Vectors& rays) {
    if (body.object.kind != BOX && body.object.kind != FREEFORM) return meet(body, start, rays);
    Eight found;
    for (int i = 0; i < LANES; ++i) {
        const Hit hit = march(body, start, lane(rays, i));
        found.depth[i] = hit.depth;
        found.face[i] = hit.face;
        set_lane(found.normal, i, hit.normal);
    }
    return found;
}

// Within 6·10⁻⁸, of angles above −3000.
Lanes sine(const Lanes& angles) {
    constexpr double of[] = {1.0, -1.0 / 6, 1.0 / 120, -1.0 / 5040, 1.0 / 362880, -1.0 / 39916800};
    constexpr double pi = 3.14159265358979323846;
    int unused[LANES];
    // half turns: a whole number, every second one with the other sign, and what is left, ± ½
    const Lanes turns = angles * (1.0 / pi) + 1024.5, whole = truncated(turns, unused), pairs = 0.5 * whole;
    const Lanes rest = (turns - whole - 0.5) * pi, square = rest * rest;
    Lanes total = of[5];
    for (int k = 4; k >= 0; --k) total = total * square + of[k];
    return total * rest * (1.0 - 4.0 * (pairs - truncated(pairs, unused)));
}

// What rays see of a white object: brightness, stains included, zero for a miss, and face.
struct Lit {
    Lanes brightness, face;
};
Lit lit(const Body& body, const Point& start, const Vectors& rays, const Light& light) {
    const Eight hit = first_hits(body, start, rays);
    const auto found = hit.face >= 0.0;
    if (!found.any()) return {0.0, hit.face};
    const Vectors point = start + choose(found, hit.depth, 0.0) * rays;
    const Lanes stains =
        sine(dot(Point{310.0, 120.0, -90.0}, point)) + sine(dot(Point{-70.0, 210.0, 260.0}, point) + 1.0);
    const Lanes facing = dot(light.lamp, hit.normal), shining = choose(facing > 0.0, facing, 0.0);
    const Lanes arriving = light.ambient + (1.0 - light.ambient) * shining;
    return {choose(found, arriving * (1.0 + 0.04 * stains), 0.0), hit.face};
}

}  // namespace

Hits cast_rays(const Body& body, const Point& origin_m, ConstMatrix directions) {
    const int count = directions.shape[0];
    Hits hits = {Array<double, 1>(count), Array<double, 2>(count, 3), Array<std::int64_t, 1>(count)};
    const Point start = origin_m - body.object.center_m;
    for (int begin = 0; begin < count; begin += LANES) {
        Vectors rays = {};
        for (int i = 0; i < LANES; ++i) set_lane(rays, i, read<Point>(&directions(std::min(begin + i, count - 1), 0)));
        const Eight found = first_hits(body, start, rays);
        for (int i = 0; i < LANES && begin + i < count; ++i) {
            hits.depths[begin + i] = found.depth[i];
            hits.faces[begin + i] = static_cast<std::int64_t>(found.face[i]);
            write(lane(found.normal, i), &hits.normals(begin + i, 0));
        }
    }
    return hits;
}

Array<float, 3> object_pixels(const Body& body, const Point& origin_m, const Rotation& turn, ConstRays padded,
                              const Window& window, const Light& light) {
    const int rows = window.rows, columns = window.columns, factor = window.factor, each = factor * factor;
    Array<float, 3> found(Unset{}, 2, rows, columns);
    // with one more on every side
    Array<std::int8_t, 2> faces(Unset{}, rows + 2, columns + 2);
    const Point start = origin_m - body.object.center_m;
    std::vector<double> x(whole_lanes(std::max(columns, each))), y(x.size()), bright(x.size()), face(x.size());
    const auto look = [&](int count) {
        for (int i = 0; i < count; i += LANES) {
            const Lit own = lit(body, start, turn.turned(Vectors{load(&x[i]), load(&y[i]), 1.0}), light);
            store(&bright[i], own.brightness);
            store(&face[i], own.face);
        }
    };
    for (int row = 0; row < rows; ++row) {
        const float* const rays = &padded(window.top + row + 1, window.left + 1, 0);
        for (int column = 0; column < columns; ++column) x[column] = rays[2 * column], y[column] = rays[2 * column + 1];
        look(columns);
        for (int column = 0; column < columns; ++column) {
            found(0, row, column) = static_cast<float>(bright[column]);
            faces(row + 1, column + 1) = static_cast<std::int8_t>(face[column]);
            found(1, row, column) = face[column] >= 0.0 ? 1.0F : 0.0F;
        }
        faces(row + 1, 0) = faces(row + 1, 1), faces(row + 1, columns + 1) = faces(row + 1, columns);
    }
    std::copy_n(&faces(1, 0), columns + 2, &faces(0, 0));
    std::copy_n(&faces(rows, 0), columns + 2, &faces(rows + 1, 0));
    std::vector<char> apart(columns);
    for (int row = 0; row < rows; ++row) {
        const std::int8_t *const above = &faces(row, 0), *const here = &faces(row + 1, 0), *below = &faces(row + 2, 0);
        for (int column = 0; column < columns; ++column) {
            std::int8_t least = here[column + 1], most = least;
            for (int k = column; k < column + 3; ++k) {
                least = std::min({least, above[k], here[k], below[k]});
                most = std::max({most, above[k], here[k], below[k]});
            }
            apart[column] = static_cast<char>(least != most);
        }
        for (int column = 0; column < columns; ++column) {
            if (!apart[column]) continue;
            for (int k = 0; k < each; ++k) {
                const int right = k % factor, down = k / factor;
                const auto ray = ray_between(padded, window.left + column + (right + 0.5) / factor - 0.5,
                                             window.top + row + (down + 0.5) / factor - 0.5);
                x[k] = ray[0], y[k] = ray[1];
            }
            look(each);
            double light_there = 0.0, part = 0.0;
            for (int k = 0; k < each; ++k) light_there += bright[k], part += face[k] >= 0.0 ? 1.0 : 0.0;
            found(0, row, column) = static_cast<float>(light_there / each);
            found(1, row, column) = static_cast<float>(part / each);
        }
    }
    return found;
}

}  // namespace vbaa::simulate
