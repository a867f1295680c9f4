#include "shooting.hpp"

#include "newton.hpp"

namespace vbaa::antenna {

namespace {

// Shares of the load, one after the other, where the whole is too much at once.
constexpr double LOAD_LADDER[] = {0.1, 0.25, 0.45, 0.7, 1.0};

// d1', d2' and M'.
struct Rates {
    Vectors d1, d2, moment;
};

// Of eight rods.
struct Sections {
    Vectors position, d1, d2, moment;
};

[[gnu::always_inline]] inline Rates rates(const Rod& rod, const Vectors& d1, const Vectors& d2, const Vectors& moment,
                                          const Vectors& internal) {
    Vectors turn = rod.bend * moment + (rod.twist - rod.bend) * dot(d1, moment) * d1;
    turn = turn + rod.curvature_y * d2 + rod.curvature_z * cross(d1, d2);
    return {cross(turn, d1), cross(turn, d2), cross(internal, d1)};
}

// Where Runge and Kutta's four rates lead.
[[gnu::always_inline]] inline Vectors mean(const Vectors& start, Lanes step, const Vectors& k1, const Vectors& k2,
                                           const Vectors& k3, const Vectors& k4) {
    return start + step / 6 * (k1 + 2.0 * (k2 + k3) + k4);
}

[[gnu::always_inline]] inline Sections stepped(const Rod& rod, const Sections& at, Lanes step, const Vectors& internal,
                                               const Point& weight) {
    Lanes half = step / 2;
    Vectors middle = internal - half * weight, end = internal - step * weight;
    Rates a = rates(rod, at.d1, at.d2, at.moment, internal);
    Vectors t2 = at.d1 + half * a.d1;
    Rates b = rates(rod, t2, at.d2 + half * a.d2, at.moment + half * a.moment, middle);
    Vectors t3 = at.d1 + half * b.d1;
    Rates c = rates(rod, t3, at.d2 + half * b.d2, at.moment + half * b.moment, middle);
    Vectors t4 = at.d1 + step * c.d1;
    Rates d = rates(rod, t4, at.d2 + step * c.d2, at.moment + step * c.moment, end);
    return {mean(at.position, step, at.d1, t2, t3, t4), mean(at.d1, step, a.d1, b.d1, c.d1, d.d1),
            mean(at.d2, step, a.d2, b.d2, c.d2, d.d2), mean(at.moment, step, a.moment, b.moment, c.moment, d.moment)};
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

Shots shoot(const Rod& rod, const RodLoads& loads, Vectors moment_Nm, int steps, double* nodes) {
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
            at = stepped(rod, at, step, force + (length - start - i * step) * weight, weight);
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
        // what is left at the tip with a share of the load
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

}  // namespace vbaa::antenna
