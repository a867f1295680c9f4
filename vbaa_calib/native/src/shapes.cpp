#include "shapes.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "equilibrium.hpp"
#include "pendulum.hpp"

namespace vbaa::antenna {

namespace {

// LANES antennas and what bends them, see vbaa_calib/antenna/shape.py.
struct Pressed {
    Lanes clamp_y_m, clamp_z_m, about_y_rad, about_z_rad, bow_y_per_m, bow_z_per_m, stiffness_Nm2, mass_kg_m, give_m;
    double length_m;
    const Taper& taper;
    Vectors gravity_m_s2;
    Lanes contact_m, push_y_N, push_z_N, friction_rad;
    bool dead;
};

// Reads LANES antennas from transposed arrays, under LANES gravities.
Pressed pressed(const Presses& lanes, Vectors gravity_m_s2) {
    double limit = (1.0 - NEAREST_TO_TIP) * lanes.length_m;
    Lanes contact = load(lanes.contact_m.data);
    Lanes p[9];
    for (int i = 0; i < 9; ++i) p[i] = load(&lanes.parameters(i, 0));
    Lanes stiffness = exp(p[6]), mass = exp(p[7]), on_shaft = where_positive(contact - limit, limit, contact);
    return {p[0],
            p[1],
            p[2],
            p[3],
            p[4],
            p[5],
            stiffness,
            mass,
            p[8],
            lanes.length_m,
            lanes.taper,
            gravity_m_s2,
            on_shaft,
            load(&lanes.push_N(0, 0)),
            load(&lanes.push_N(1, 0)),
            load(lanes.friction_rad.data),
            lanes.dead};
}

void put(Cube field, int node, Vectors v) {
    store(&field(0, node, 0), v.x);
    store(&field(1, node, 0), v.y);
    store(&field(2, node, 0), v.z);
}

auto into(Cube field, int first) {
    return [=](std::size_t row, const Vectors& v) { put(field, first + int(row), v); };
}

void put_loads(const Made& made, Vectors force_N, Lanes moment_Nm) {
    store(&made.force_N(0, 0), force_N.x);
    store(&made.force_N(1, 0), force_N.y);
    store(&made.force_N(2, 0), force_N.z);
    store(made.moment_Nm.data, moment_Nm);
}

// Rotation by the vector (0, y, z) in rad: Rodrigues' formula.
Frame rotation(Lanes about_y, Lanes about_z) {
    Lanes half = 0.5 * sqrt(about_y * about_y + about_z * about_z);
    const SineCosine turn = sine_and_cosine(half);
    Lanes half_sinc = where_positive(half, turn.sine / half, 1.0);
    Lanes sine = half_sinc * turn.cosine, versine = 0.5 * half_sinc * half_sinc;
    Lanes y = sine * about_y, z = sine * about_z, both = versine * about_y * about_z;
    Lanes y_square = versine * about_y * about_y, z_square = versine * about_z * about_z;
    return {{1.0 - y_square - z_square, z, -y}, {-z, 1.0 - z_square, both}, {y, both, 1.0 - y_square}};
}

// Interpolate the first shape's tangents, eight nodes at a time.
void put_first_tangents(const Field& field, Cube tangents) {
    const NodeTables& tables = node_tables();
    for (int row = 0; row < NODE_ROWS; ++row) {
        Vectors total = {};
        auto add = [&](const double* weights, const Vectors& v) {
            Lanes nodes = load(weights);
            total = total + Vectors{v.x[0] * nodes, v.y[0] * nodes, v.z[0] * nodes};
        };
        if (row < INNER_ROWS)
            for (int node = 0; node < INNER_NODES; ++node) add(&tables.by_inner_node[node][LANES * row], field[node]);
        else
            for (int node = 0; node < OUTER_NODES; ++node)
                add(&tables.by_outer_node[node][LANES * (row - INNER_ROWS)], field[INNER_NODES + node]);
        put(tangents, row, total);
    }
}

void put_tangents(const Field& field, Cube tangents) {
    const NodeTables& tables = node_tables();
    integrated(tables.at_inner_curve, field.data(), Vectors{}, into(tangents, 0));
    integrated(tables.at_outer_curve, &field[INNER_NODES], Vectors{}, into(tangents, NODES_TO_CONTACT));
}

// Integrate the tangents, which are multiplied by their side's length, from the clamp on.
void put_points(const Pressed& press, Field& field, Cube points_m) {
    const NodeTables& tables = node_tables();
    Lanes beyond = press.length_m - press.contact_m;
    for (int node = 0; node < NODES; ++node)
        field[node] = (node < INNER_NODES ? press.contact_m : beyond) * field[node];
    Vectors clamp = {Lanes{}, press.clamp_y_m, press.clamp_z_m};
    integrated(tables.to_inner_curve, field.data(), clamp, into(points_m, 0));
    Vectors contact = {load(&points_m(0, CONTACT, 0)), load(&points_m(1, CONTACT, 0)), load(&points_m(2, CONTACT, 0))};
    integrated(tables.to_outer_curve, &field[INNER_NODES], contact, into(points_m, NODES_TO_CONTACT));
}

// Arc lengths of a node of the curve.
[[gnu::always_inline]] inline Lanes arclength_at(const Pressed& press, int node) {
    const Lanes length = spread(press.length_m);
    Lanes s = spread(curve_share(node)) * (node <= CONTACT ? press.contact_m : length - press.contact_m);
    if (node > CONTACT) s += press.contact_m;
    return where_positive(s - length, length, s);
}

[[gnu::always_inline]] inline void put_tangent(Cube tangents, int node, const Vectors& tangent) {
    if (tangents.shape[1] == CURVE_NODES) {
        put(tangents, node, tangent);
    } else if (tangents.shape[1]) {
        tangents(0, node / LANES, node % LANES) = tangent.x[0];
        tangents(1, node / LANES, node % LANES) = tangent.y[0];
        tangents(2, node / LANES, node % LANES) = tangent.z[0];
    }
}

// Points and tangents of the curve, from the tangents on all panels, part after part.
void put_curve(const Pressed& press, const PanelNodes& nodes, const PanelField& tangents, const Made& made) {
    Vectors at = {Lanes{}, press.clamp_y_m, press.clamp_z_m};
    int next = 0;  // first node that lies in this part, or beyond it, in some lane
    for (int p = 0; p < nodes.count; ++p) {
        const Part& part = nodes.parts[p];
        const bool last = p == nodes.count - 1;
        // by powers of x from −1 to 1
        std::array<Vectors, NodeTables::PANEL> slope;
        std::array<Vectors, NodeTables::PANEL + 1> place;
        for (int power = 0; power < NodeTables::PANEL; ++power) {
            Vectors total = {};
            for (int j = 0; j < NodeTables::PANEL; ++j)
                total = total + node_tables().panel_powers[power][j] * tangents[p * NodeTables::PANEL + j];
            slope[power] = total;
            place[power + 1] = 0.5 / (power + 1) * part.width_m * total;
        }
        place[0] = at;
        for (int power = 1; power <= NodeTables::PANEL; ++power)
            place[0] = power % 2 ? place[0] + place[power] : place[0] - place[power];
        const Lanes end = part.start_m + part.width_m;
        const Lanes by_width = where_positive(part.width_m, 1.0 / part.width_m, part.width_m);
        for (int node = next; node < CURVE_NODES; ++node) {
            const Lanes s = arclength_at(press, node);
            if (!last && !(~(s > end)).any()) break;
            // the first part takes all nodes that no later one contains
            const Lanes::Mask here =
                p ? ~(s < part.start_m)
                  : Lanes::Mask::each([](int) { return Lanes::Mask::Part{} == Lanes::Mask::Part{}; });
            const Lanes x = 2.0 * (s - part.start_m) * by_width - 1.0;
            Vectors point = place[NodeTables::PANEL], tangent = slope[NodeTables::PANEL - 1];
            for (int power = NodeTables::PANEL - 1; power >= 0; --power) {
                point = x * point + place[power];
                if (power < NodeTables::PANEL - 1) tangent = x * tangent + slope[power];
            }
            const auto kept = [&](Lanes value, const double* before) { return choose(here, value, load(before)); };
            put(made.points_m, node,
                {kept(point.x, &made.points_m(0, node, 0)), kept(point.y, &made.points_m(1, node, 0)),
                 kept(point.z, &made.points_m(2, node, 0))});
            if (made.tangents.shape[1] == CURVE_NODES)
                tangent = {kept(tangent.x, &made.tangents(0, node, 0)), kept(tangent.y, &made.tangents(1, node, 0)),
                           kept(tangent.z, &made.tangents(2, node, 0))};
            if (made.tangents.shape[1] == CURVE_NODES || here[0]) put_tangent(made.tangents, node, tangent);
            if (!last && node == next && !(~(s < end)).any()) ++next;
        }
        for (int power = 1; power <= NodeTables::PANEL; power += 2) place[0] = place[0] + place[power];
        for (int power = 2; power <= NodeTables::PANEL; power += 2) place[0] = place[0] + place[power];
        at = place[0];
    }
}

// Large deflections.
void bend_far(int sweeps, const Pressed& press, const Made& made) {
    Lanes stiffness = press.stiffness_Nm2, friction = press.friction_rad;
    Frame clamp = rotation(press.about_y_rad, press.about_z_rad);
    Vectors applied = {Lanes{}, press.push_y_N / stiffness, press.push_z_N / stiffness};
    if (press.dead) {
        applied = clamp.turned_back(applied);
        friction = Lanes{};
    }
    Lanes size = sqrt(applied.y * applied.y + applied.z * applied.z);
    // the force's direction; along y where there is none
    Lanes y = where_positive(size, applied.y / size, 1.0), z = where_positive(size, applied.z / size, applied.z);
    // the clamp's frame, rolled until its y points there
    Frame frame = {clamp.x, y * clamp.y + z * clamp.z, y * clamp.z - z * clamp.y};
    Vectors weight = press.mass_kg_m / stiffness * press.gravity_m_s2;
    Loads loads = {press.contact_m,
                   spread(press.length_m),
                   size,
                   friction,
                   press.dead,
                   applied.x,
                   frame.turned_back(weight),
                   press.bow_y_per_m * y + press.bow_z_per_m * z,
                   press.bow_z_per_m * y - press.bow_y_per_m * z,
                   press.give_m};
    Equilibrium found;
    const auto turn = [&](Vectors* tangents, int count) {
        frame = {frame.turned(found.axes.x), frame.turned(found.axes.y), frame.turned(found.axes.z)};
        for (int node = 0; node < count; ++node) tangents[node] = frame.turned(tangents[node]);
    };
    if (press.taper) {
        constexpr int FURTHER_SWEEPS = 2;  // the soft end of a tapered antenna turns more between sweeps
        const PanelNodes panels = panel_nodes(press.taper, press.contact_m, press.length_m);
        PanelField tangents;
        found = equilibrium(loads, panels, sweeps + FURTHER_SWEEPS, tangents);
        turn(tangents.data(), panels.count * NodeTables::PANEL);
        put_curve(press, panels, tangents, made);
    } else {
        Field nodes;
        found = equilibrium(loads, sweeps, nodes);
        turn(nodes.data(), NODES);
        if (made.tangents.shape[1] == CURVE_NODES) put_tangents(nodes, made.tangents);
        if (made.tangents.shape[1] == NODE_ROWS) put_first_tangents(nodes, made.tangents);
        put_points(press, nodes, made.points_m);
    }
    Vectors force = frame.turned(found.force_per_m2);
    // about the antenna frame's origin, from which the clamp is off by (0, y, z)
    Lanes moment = frame.turned(found.moment_per_m).y;
    Lanes about_origin = moment + press.clamp_z_m * (force.x + press.taper.weight * press.length_m * weight.x);
    put_loads(made, stiffness * force, -stiffness * about_origin);
}

// A pair (y, z) of small deflections, slopes, or their causes.
struct Lateral {
    Lanes y, z;
};

Lateral operator+(Lateral a, Lateral b) { return {a.y + b.y, a.z + b.z}; }
Lateral operator*(Lanes factor, Lateral a) { return {factor * a.y, factor * a.z}; }

// Deflection of a clamp of unit stiffness at arc lengths, by a unit push at the contact and by a unit weight per
// length at the clamp.
struct Unit {
    Lanes by_push, slope_by_push, by_weight, slope_by_weight;
};

Unit bent_by_unit(const Pressed& press, Lanes s) {
    Unit found;
    const double length = press.length_m;
    for (int lane = 0; lane < LANES; ++lane) {
        const double at = s[lane] / length, contact = press.contact_m[lane] / length;
        const Integrals here = integrals_at(press.taper, at);
        found.by_push[lane] = length * length * length * deflection(press.taper, at, contact);
        const Integrals near = at < contact ? here : integrals_at(press.taper, contact);
        found.slope_by_push[lane] = length * length * (contact * near.c - near.cx);
        found.by_weight[lane] = length * length * length * length * (at * here.weighed - here.weighed_x);
        found.slope_by_weight[lane] = length * length * length * here.weighed;
    }
    return found;
}

// Small deflections of contact, lateral weight, bow, clamp and its give, superposed (vbaa_calib/antenna/linear.py).
//
// The paper's beam has the contact alone. A contact before the clamp gives NaN.
void bend_little(bool paper, const Pressed& press, const Made& made) {
    Lanes contact = where_positive(-press.contact_m, std::numeric_limits<double>::quiet_NaN(), press.contact_m);
    Lanes compliance = 1.0 / press.stiffness_Nm2, friction = Lanes{};
    const Lanes length = spread(press.length_m);
    Lateral push = {press.push_y_N, press.push_z_N}, clamp_moment = contact * push, start = {}, turn = {}, bow = {};
    Vectors weight = {};
    const double weight_lever = press.taper ? press.taper.weight_moment : 0.5;
    if (!paper) {
        start = {press.clamp_y_m, press.clamp_z_m};
        weight = press.mass_kg_m * press.gravity_m_s2;
        clamp_moment = clamp_moment + weight_lever * length * length * Lateral{weight.y, weight.z};
        // turned or bowed about z the antenna goes to +y, about y to −z
        turn = Lateral{press.about_z_rad, -press.about_y_rad} + press.give_m * compliance * clamp_moment;
        bow = {press.bow_z_per_m, -press.bow_y_per_m};
        SineCosine angle = sine_and_cosine(press.friction_rad);
        friction = -sqrt(push.y * push.y + push.z * push.z) * (angle.sine / angle.cosine);
    }
    Lateral sagging = {weight.y, weight.z}, at_contact = {};
    for (int node = 0; node < CURVE_NODES; ++node) {
        const Lanes s = arclength_at(press, node);
        Lanes near = where_positive(contact - s, s, contact), far = where_positive(contact - s, contact, s);
        Lanes by_push = (3.0 * far - near) * near * near * compliance / 6.0;
        Lanes by_weight = s * s * (6.0 * length * length - 4.0 * length * s + s * s) * compliance / 24.0;
        Unit uneven;
        if (press.taper) {
            uneven = bent_by_unit(press, s);
            by_push = uneven.by_push * compliance;
            by_weight = uneven.by_weight * compliance;
        }
        Lateral at = start + s * (turn + 0.5 * s * bow) + by_push * push + by_weight * sagging;
        put(made.points_m, node, {s, at.y, at.z});
        if (made.tangents.shape[1] || node == CONTACT) {
            by_push = 0.5 * compliance * (2.0 * contact - near) * near;
            by_weight = s * (3.0 * length * length - 3.0 * length * s + s * s) * compliance / 6.0;
            if (press.taper) {
                by_push = uneven.slope_by_push * compliance;
                by_weight = uneven.slope_by_weight * compliance;
            }
            Lateral slope = turn + s * bow + by_push * push + by_weight * sagging;
            Lanes x = 1.0 / sqrt(1.0 + slope.y * slope.y + slope.z * slope.z);
            Vectors tangent = {x, slope.y * x, slope.z * x};
            put_tangent(made.tangents, node, tangent);
            if (node == CONTACT) at_contact = slope;
        }
    }
    // the force along x changes shape and moment to second order only, but the force's direction to first order
    Lanes along = friction - push.y * at_contact.y - push.z * at_contact.z;
    put_loads(made, {along, push.y, push.z}, clamp_moment.z - start.z * (friction + length * weight.x));
}

void bend(int rung, int sweeps, const Pressed& press, const Made& made) {
    if (rung <= LINEAR)
        bend_little(rung == PAPER, press, made);
    else
        bend_far(sweeps, press, made);
}

}  // namespace

void bend_lanes(int rung, const Presses& presses, const Made& made) {
    const auto gravity = [&](int axis) {
        const double* row = &presses.gravity_m_s2(axis, 0);
        return presses.gravity_m_s2.shape[1] == 1 ? spread(*row) : load(row);
    };
    Pressed press = pressed(presses, {gravity(0), gravity(1), gravity(2)});
    bend(rung, sweeps_of(rung), press, made);
}

Bent bend_batch(int rung, int sweeps, const Presses& presses) {
    int count = presses.contact_m.shape[0];
    Bent bent = {Array<double, 3>(count, CURVE_NODES, 3), Array<double, 3>(count, CURVE_NODES, 3),
                 Array<double, 2>(count, 3), Array<double, 1>(count)};
    Array<double, 2> parameters(9, LANES), gravity(3, LANES), push(2, LANES), force(3, LANES);
    Array<double, 1> contact(LANES), friction(LANES), moment(LANES);
    Array<double, 3> points(3, CURVE_NODES, LANES), tangents(3, CURVE_NODES, LANES);
    for (int start = 0; start < count; start += LANES) {
        for (int lane = 0; lane < LANES; ++lane) {
            // the last eight are filled with copies of the last shape
            int row = std::min(start + lane, count - 1);
            for (int i = 0; i < 9; ++i) parameters(i, lane) = presses.parameters(row, i);
            for (int i = 0; i < 3; ++i) gravity(i, lane) = presses.gravity_m_s2(row, i);
            for (int i = 0; i < 2; ++i) push(i, lane) = presses.push_N(row, i);
            contact[lane] = presses.contact_m[row];
            friction[lane] = presses.friction_rad[row];
        }
        Vectors weight = {load(&gravity(0, 0)), load(&gravity(1, 0)), load(&gravity(2, 0))};
        const Presses lanes = {parameters, presses.length_m, presses.taper, gravity, contact.view(),
                               push,       friction.view(),  presses.dead};
        Pressed press = pressed(lanes, weight);
        bend(rung, sweeps, press, {points, tangents, force, moment});
        for (int lane = 0; lane < std::min(LANES, count - start); ++lane) {
            int row = start + lane;
            for (int axis = 0; axis < 3; ++axis) bent.force_N(row, axis) = force(axis, lane);
            for (int node = 0; node < CURVE_NODES; ++node)
                for (int axis = 0; axis < 3; ++axis) {
                    bent.points_m(row, node, axis) = points(axis, node, lane);
                    bent.tangents(row, node, axis) = tangents(axis, node, lane);
                }
            bent.moment_Nm[row] = moment[lane];
        }
    }
    return bent;
}

}  // namespace vbaa::antenna
