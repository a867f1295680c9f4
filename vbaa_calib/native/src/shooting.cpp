#include "shooting.hpp"

#include <algorithm>
#include <cmath>

#include "newton.hpp"

namespace vbaa::antenna {

namespace {

// Shares of the load, applied one after the other where Newton's method fails for the whole.
constexpr double LOAD_LADDER[] = {0.1, 0.25, 0.45, 0.7, 1.0};

// d1', d2' and M'.
struct Rates {
    Vectors d1, d2, moment;
};

// Sections of eight rods at one arc length each.
struct Sections {
    Vectors position, d1, d2, moment;
};

// Curvature by a moment, relative to the clamp's flexibility: of a uniform rod, and of a softer part of a tapered one.
struct Uniform {
    Vectors of(const Vectors& moment) const { return moment; }
};
struct Softer {
    Lanes flexibility;
    Vectors of(const Vectors& moment) const { return flexibility * moment; }
};

template <class Soft>
[[gnu::always_inline]] inline Rates rates(const Rod& rod, const Soft& soft, const Vectors& d1, const Vectors& d2,
                                          const Vectors& moment, const Vectors& internal) {
    const Vectors bent = soft.of(moment);
    Vectors turn = rod.bend * bent + (rod.twist - rod.bend) * dot(d1, bent) * d1;
    turn = turn + rod.curvature_y * d2 + rod.curvature_z * cross(d1, d2);
    return {cross(turn, d1), cross(turn, d2), cross(internal, d1)};
}

// The end of a Runge–Kutta step, from its four rates.
[[gnu::always_inline]] inline Vectors mean(const Vectors& start, Lanes step, const Vectors& k1, const Vectors& k2,
                                           const Vectors& k3, const Vectors& k4) {
    return start + step / 6 * (k1 + 2.0 * (k2 + k3) + k4);
}

// Start, middle and end of a step: how soft the rod is, and the internal force.
template <class Soft>
struct Along {
    Soft soft[3];
    Vectors internal[3];
};

template <class Soft>
[[gnu::always_inline]] inline Sections stepped(const Rod& rod, const Sections& at, Lanes step,
                                               const Along<Soft>& along) {
    Lanes half = step / 2;
    const auto& [start, middle, end] = along.internal;
    Rates a = rates(rod, along.soft[0], at.d1, at.d2, at.moment, start);
    Vectors t2 = at.d1 + half * a.d1;
    Rates b = rates(rod, along.soft[1], t2, at.d2 + half * a.d2, at.moment + half * a.moment, middle);
    Vectors t3 = at.d1 + half * b.d1;
    Rates c = rates(rod, along.soft[1], t3, at.d2 + half * b.d2, at.moment + half * b.moment, middle);
    Vectors t4 = at.d1 + step * c.d1;
    Rates d = rates(rod, along.soft[2], t4, at.d2 + step * c.d2, at.moment + step * c.moment, end);
    return {mean(at.position, step, at.d1, t2, t3, t4), mean(at.d1, step, a.d1, b.d1, c.d1, d.d1),
            mean(at.d2, step, a.d2, b.d2, c.d2, d.d2), mean(at.moment, step, a.moment, b.moment, c.moment, d.moment)};
}

// A step back from one arc length to another, over the slices between.
Sections back_over_slices(const Rod& rod, Sections at, Lanes from_m, Lanes to_m, const Vectors& force,
                          const Point& weight) {
    double least = rod.length_m, most = 0.0;
    for (int lane = 0; lane < LANES; ++lane) {
        least = std::min<double>(least, to_m[lane]);
        most = std::max<double>(most, from_m[lane]);
    }
    for (auto slice = rod.slices.rbegin(); slice != rod.slices.rend(); ++slice) {
        if (slice->start_m >= most) continue;
        if (slice->end_m <= least) break;
        const Lanes first = spread(slice->start_m), last = spread(slice->end_m);
        const Lanes start = where_positive(from_m - last, last, from_m),
                    end = where_positive(first - to_m, first, to_m);
        // zero for rods with arc lengths outside the slice
        const Lanes step = where_positive(start - end, end - start, Lanes{});
        const double by_length = 1.0 / (slice->end_m - slice->start_m), thick = slice->diameters[0];
        Along<Softer> along;
        for (int k = 0; k < 3; ++k) {
            Lanes share = (start + 0.5 * k * step - slice->start_m) * by_length;
            share = where_positive(share, where_positive(share - 1.0, spread(1.0), share), Lanes{});
            const Lanes root = slice->roots[0] + (slice->roots[1] - slice->roots[0]) * share, square = root * root;
            along.soft[k].flexibility = 1.0 / (slice->power == 1 ? root : square * square);
            const Lanes here = thick + (slice->diameters[1] - thick) * share;
            const Lanes before =
                share * (slice->end_m - slice->start_m) / 3.0 * (thick * thick + thick * here + here * here);
            along.internal[k] = force + (slice->mass_beyond_m - before) * weight;
        }
        at = stepped(rod, at, step, along);
    }
    return at;
}

// Rotates a vector by the rotation vector u.
Vectors turned_by(Vectors u, const Point& v) {
    const Lanes angle = norm(u), half = 0.5 * angle;
    const Lanes by_angle = where_positive(angle - 1e-9, sin(angle) / angle, spread(1.0));
    const Lanes half_sinc = where_positive(half - 1e-9, sin(half) / half, spread(1.0));
    const Vectors once = cross(u, v);
    return v + by_angle * once + 0.5 * half_sinc * half_sinc * cross(u, once);
}

void write_node(const Sections& at, double* node) {
    for (const Vectors& each : {at.position, at.d1, at.d2, at.moment}) {
        write(lane(each, 0), node);
        node += 3;
    }
}

// A share of one of loads (B, 7), eight times.
RodLoads load_of(ConstMatrix loads, int b, double share) {
    Point gravity = read<Point>(&loads(b, 0)), force = read<Point>(&loads(b, 3));
    return {share * gravity, spread(share) * force, spread(loads(b, 6))};
}

}  // namespace

std::vector<Slice> slices_of(ConstMatrix pieces, double length_m) {
    constexpr double LARGEST_CHANGE = 0.15;  // of the logarithm of the stiffness in a slice
    std::vector<Slice> slices;
    for (int p = 0; p < pieces.shape[0]; ++p) {
        const double* piece = pieces.row(p).data;
        const int power = static_cast<int>(piece[6]);
        const double growth = piece[5] / piece[4] - 1.0, changes = power * std::abs(std::log1p(growth));
        const int count = 1 + static_cast<int>(changes / LARGEST_CHANGE);
        const auto between = [&](int column, double share) {
            return piece[column] + (piece[column + 1] - piece[column]) * share;
        };
        for (int k = 0; k < count; ++k) {
            double shares[2];
            for (int side = 0; side < 2; ++side) {
                const double share = static_cast<double>(k + side) / count;
                shares[side] = std::abs(growth) < 1e-6 ? share : std::expm1(share * std::log1p(growth)) / growth;
            }
            slices.push_back({length_m * between(0, shares[0]),
                              length_m * between(0, shares[1]),
                              {between(2, shares[0]), between(2, shares[1])},
                              {between(4, shares[0]), between(4, shares[1])},
                              power,
                              0.0});
        }
        slices.back().end_m = length_m * piece[1];
    }
    double beyond = 0.0;
    for (auto slice = slices.rbegin(); slice != slices.rend(); ++slice) {
        const auto& [thick, thin] = slice->diameters;
        beyond += (slice->end_m - slice->start_m) / 3.0 * (thick * thick + thick * thin + thin * thin);
        slice->mass_beyond_m = beyond;
    }
    return slices;
}

Lanes diameter_at(const Rod& rod, const Lanes& arclength_m) {
    Lanes found = spread(1.0);
    for (int lane = 0; lane < LANES; ++lane) {
        const double at = arclength_m[lane];
        for (const Slice& slice : rod.slices) {
            if (at < slice.start_m) break;
            const double share = std::min((at - slice.start_m) / (slice.end_m - slice.start_m), 1.0);
            found[lane] = slice.diameters[0] + (slice.diameters[1] - slice.diameters[0]) * share;
        }
    }
    return found;
}

namespace {

// Integrates back from the tip, with a trial rotation of the tip relative to the clamp.
Shots shoot_back(const Rod& rod, const RodLoads& loads, Vectors turn, int steps, double* nodes) {
    const Lanes length = spread(rod.length_m);
    const auto at_tip = loads.contact_m >= length;
    const Lanes split = choose(at_tip, 0.5 * length, loads.contact_m);
    const Point weight = rod.mass_per_length_kg_m * loads.gravity_m_s2, d3 = cross(rod.d1, rod.d2);
    Sections at = {Vectors{}, turned_by(turn, rod.d1), turned_by(turn, rod.d2), Vectors{}}, middle = at;
    const Vectors tip = at.d1;
    for (int segment = 1; segment >= 0; --segment) {
        const Lanes start = segment ? split : Lanes{}, end = segment ? length : split, step = (end - start) / steps;
        const Vectors force = choose(at_tip, spread(1.0), spread(segment ? 0.0 : 1.0)) * loads.force_N;
        for (int i = steps; i > 0; --i) {
            if (nodes) write_node(at, nodes + 12 * (segment * steps + i));
            const Lanes from = i == steps ? end : start + i * step, to = i == 1 ? start : start + (i - 1) * step;
            at = back_over_slices(rod, at, from, to, force, weight);
        }
        if (segment) middle = at;
    }
    if (nodes) write_node(at, nodes);
    const Vectors shift = rod.origin - at.position;
    for (int k = 0; nodes && k <= 2 * steps; ++k) {
        const Point moved = read<Point>(nodes + 12 * k) + lane(shift, 0);
        write(moved, nodes + 12 * k);
    }
    const auto contact = [&](const Vectors& last, const Vectors& inside) {
        return Vectors{choose(at_tip, last.x, inside.x), choose(at_tip, last.y, inside.y),
                       choose(at_tip, last.z, inside.z)};
    };
    const Vectors off = cross(at.d1, rod.d1) + cross(at.d2, rod.d2) + cross(cross(at.d1, at.d2), d3);
    const double unit = 1.0 / (rod.bend * rod.length_m);
    return {contact(shift, middle.position + shift), contact(tip, middle.d1), 0.5 * unit * off};
}

}  // namespace

Shots shoot(const Rod& rod, const RodLoads& loads, Vectors moment_Nm, int steps, double* nodes) {
    if (!rod.slices.empty()) return shoot_back(rod, loads, rod.bend * rod.length_m * moment_Nm, steps, nodes);
    Lanes length = spread(rod.length_m);
    auto at_tip = loads.contact_m >= length;
    Lanes split = choose(at_tip, 0.5 * length, loads.contact_m);
    Point weight = rod.mass_per_length_kg_m * loads.gravity_m_s2;
    Vectors zero = {};
    Sections at = {zero + rod.origin, zero + rod.d1, zero + rod.d2, moment_Nm}, middle = at;
    for (int segment = 0; segment < 2; ++segment) {
        Lanes step = (segment ? length - split : split) / steps, start = segment ? split : Lanes{};
        Lanes pushed = choose(at_tip, spread(1.0), spread(segment ? 0.0 : 1.0));
        Vectors force = pushed * loads.force_N;
        for (int i = 0; i < steps; ++i) {
            if (nodes) write_node(at, nodes + 12 * (segment * steps + i));
            const Vectors internal = force + (length - start - i * step) * weight;
            at = stepped(rod, at, step,
                         Along<Uniform>{{}, {internal, internal - step / 2 * weight, internal - step * weight}});
        }
        if (segment == 0) middle = at;
    }
    if (nodes) write_node(at, nodes + 24 * steps);
    auto contact = [&](const Vectors& tip, const Vectors& inside) {
        return Vectors{choose(at_tip, tip.x, inside.x), choose(at_tip, tip.y, inside.y),
                       choose(at_tip, tip.z, inside.z)};
    };
    return {contact(at.position, middle.position), contact(at.d1, middle.d1), at.moment};
}

Array<double, 4> shoot_rods(const Rod& rod, ConstMatrix loads, ConstMatrix moment_Nm, int steps) {
    Array<double, 4> nodes(loads.shape[0], 2 * steps + 1, 4, 3);
    for (int b = 0; b < loads.shape[0]; ++b) {
        Vectors moment = spread(1.0) * read<Point>(&moment_Nm(b, 0));
        shoot(rod, load_of(loads, b, 1.0), moment, steps, nodes.row(b).data);
    }
    return nodes;
}

Rods solve_rods(const Rod& rod, ConstMatrix loads, double unit_Nm, ConstMatrix limit_Nm, ConstMatrix moment_Nm,
                int steps) {
    int count = loads.shape[0];
    Rods rods = {{}, Array<double, 2>(moment_Nm), Array<double, 1>(count)};
    for (int b = 0; b < count; ++b) {
        double bound = limit_Nm(b, 0) / unit_Nm, scale = 1.0 / limit_Nm(b, 1);
        Numbers<3> upper = {bound, bound, bound}, lower = {-bound, -bound, -bound}, x;
        for (int j = 0; j < 3; ++j) x[j] = moment_Nm(b, j) / unit_Nm;
        // residual moment at the tip with a share of the load
        auto solved = [&](double share) {
            RodLoads load = load_of(loads, b, share);
            auto tip_moment = [&](const std::array<Lanes, 3>& trial) {
                Vectors moment = {unit_Nm * trial[0], unit_Nm * trial[1], unit_Nm * trial[2]};
                Vectors tip = scale * shoot(rod, load, moment, steps).tip_moment_Nm;
                return std::array<Lanes, 3>{tip.x, tip.y, tip.z};
            };
            return newton<3>(tip_moment, x, lower, upper, ROD_TOLERANCE);
        };
        rods.left[b] = solved(1.0);
        if (!(rods.left[b] <= ROD_TOLERANCE)) {
            x = {};
            for (double share : LOAD_LADDER) rods.left[b] = solved(share);
        }
        for (int j = 0; j < 3; ++j) rods.moment_Nm(b, j) = unit_Nm * x[j];
    }
    rods.nodes = shoot_rods(rod, loads, rods.moment_Nm, steps);
    return rods;
}

namespace {

struct Touch {
    double at_m, lateral_N[2], friction_rad;
};

// What bends a rod that is touched twice; its clamp gives way to its moment.
struct TwoTouches {
    Point gravity;
    Touch touches[2];
    double give_m;
};

// Residuals of eight trial solutions: the moment at the tip, and the directions of both forces.
std::array<Lanes, 5> shoot_twice(const Rod& rod, const TwoTouches& loads, const std::array<Lanes, 5>& trial, int steps,
                                 double* nodes) {
    const auto& [gravity, touches, give_m] = loads;
    const double unit = 1.0 / (rod.bend * rod.length_m), unit_N = unit / rod.length_m;
    const Point weight = rod.mass_per_length_kg_m * gravity, d3 = cross(rod.d1, rod.d2);
    const Vectors moment = {unit * trial[0], unit * trial[1], unit * trial[2]};
    const Vectors give = (give_m * rod.bend) * (moment - dot(moment, rod.d1) * rod.d1);
    Sections at = {Vectors{} + rod.origin, turned_by(give, rod.d1), turned_by(give, rod.d2), moment};
    Vectors forces[3] = {};
    for (int touch = 1; touch >= 0; --touch) {
        const auto& [along_y, along_z] = touches[touch].lateral_N;
        const Vectors own = (unit_N * trial[3 + touch]) * rod.d1 + (along_y * rod.d2 + along_z * d3);
        forces[touch] = forces[touch + 1] + own;
    }
    std::array<Lanes, 5> left;
    for (int segment = 0; segment < 3; ++segment) {
        const double start = segment ? touches[segment - 1].at_m : 0.0;
        const double end = segment < 2 ? touches[segment].at_m : rod.length_m, step = (end - start) / steps;
        for (int i = 0; i < steps; ++i) {
            if (nodes) write_node(at, nodes + 12 * (segment * steps + i));
            const Vectors internal = forces[segment] + (rod.length_m - start - i * step) * weight;
            at = stepped(rod, at, spread(step),
                         Along<Uniform>{{}, {internal, internal - step / 2 * weight, internal - step * weight}});
        }
        if (segment < 2) {
            const Vectors own = forces[segment] - forces[segment + 1];
            const auto& [along_y, along_z] = touches[segment].lateral_N;
            // a force of zero has no direction: its component along x is set to zero
            const double scale = std::hypot(along_y, along_z) + 1e-3 * unit_N;
            left[3 + segment] = (dot(own, at.d1) + std::sin(touches[segment].friction_rad) * norm(own)) / scale;
        }
    }
    if (nodes) write_node(at, nodes + 36 * steps);
    left[0] = at.moment.x / unit, left[1] = at.moment.y / unit, left[2] = at.moment.z / unit;
    return left;
}

}  // namespace

TouchedTwice solve_touched_twice(const Rod& rod, ConstMatrix loads, double give_m, ConstMatrix start, int steps) {
    constexpr double FARTHEST = 50.0;  // of moments in EI/L and forces in EI/L²
    const int count = loads.shape[0];
    TouchedTwice found = {Array<double, 4>(count, 3 * steps + 1, 4, 3), Array<double, 2>(start),
                          Array<double, 1>(count)};
    Numbers<5> upper, lower;
    upper.fill(FARTHEST), lower.fill(-FARTHEST);
    for (int b = 0; b < count; ++b) {
        TwoTouches bending = {read<Point>(&loads(b, 0)), {}, give_m};
        for (int touch = 0; touch < 2; ++touch) {
            const double* own = &loads(b, 3 + 4 * touch);
            bending.touches[touch] = {own[0], {own[1], own[2]}, own[3]};
        }
        Numbers<5> x;
        const auto solved = [&](double share) {
            TwoTouches shared = bending;
            shared.gravity = share * bending.gravity;
            for (Touch& one : shared.touches) one.lateral_N[0] *= share, one.lateral_N[1] *= share;
            return newton<5>(
                [&](const std::array<Lanes, 5>& trial) { return shoot_twice(rod, shared, trial, steps, nullptr); }, x,
                lower, upper, ROD_TOLERANCE);
        };
        for (int j = 0; j < 5; ++j) x[j] = start(b, j);
        found.left[b] = solved(1.0);
        if (!(found.left[b] <= 1e3 * ROD_TOLERANCE)) {
            x = {};
            for (double share : LOAD_LADDER) found.left[b] = solved(share);
        }
        std::array<Lanes, 5> whole;
        for (int j = 0; j < 5; ++j) found.solution(b, j) = x[j], whole[j] = spread(x[j]);
        shoot_twice(rod, bending, whole, steps, found.nodes.row(b).data);
    }
    return found;
}

}  // namespace vbaa::antenna
