#include "../nodes.hpp"
#include "../pendulum.hpp"
#include "../shapes.hpp"
#include "rod.hpp"

namespace vbaa {

namespace {

using antenna::CURVE_NODES;
using antenna::NODE_ROWS;

constexpr int MOST_SWEEPS = 100, MOST_STEPS = 10000;

// Parameters (B, 9), length, m, and pieces of the taper; contacts (B,), pushes (B, 2) and friction angles (B,).
using Wires = std::tuple<InMatrix, double, InMatrix>;
using Pushes = std::tuple<InVector, InMatrix, InVector>;

antenna::Presses presses(const Wires& wires, const antenna::Taper& taper, const InMatrix& gravity_m_s2,
                         const Pushes& pushes, bool dead) {
    const auto& [parameters, length_m, pieces] = wires;
    const auto& [contact_m, push_N, friction_rad] = pushes;
    std::size_t count = contact_m.shape(0);
    require(parameters.shape(0) == count && parameters.shape(1) == 9 && gravity_m_s2.shape(0) == count &&
                gravity_m_s2.shape(1) == 3 && push_N.shape(0) == count && push_N.shape(1) == 2 &&
                friction_rad.shape(0) == count,
            "shapes need parameters (B, 9), gravity (B, 3), contacts (B,), forces (B, 2) and friction (B,)");
    return {view(parameters), length_m,           taper, view(gravity_m_s2), view(contact_m),
            view(push_N),     view(friction_rad), dead};
}

void check_rung(int rung) { require(antenna::PAPER <= rung && rung <= antenna::ROD, "no such rung"); }

auto bent(int rung, int sweeps, const antenna::Presses& presses) {
    auto made = unlocked([&] { return antenna::bend_batch(rung, sweeps, presses); });
    return arrays(made.points_m, made.tangents, made.force_N, made.moment_Nm);
}

auto curves(int rung, const Wires& wires, const InMatrix& gravity_m_s2, const Pushes& pushes) {
    check_rung(rung);
    const antenna::Taper taper = read_taper(view(std::get<2>(wires)));
    return bent(rung, antenna::sweeps_of(rung), presses(wires, taper, gravity_m_s2, pushes, false));
}

auto bend(bool dead, int sweeps, const Wires& wires, const InMatrix& gravity_m_s2, const Pushes& pushes) {
    require(0 <= sweeps && sweeps <= MOST_SWEEPS, "there are 0 to 100 sweeps");
    const antenna::Taper taper = read_taper(view(std::get<2>(wires)));
    return bent(antenna::ROD, sweeps, presses(wires, taper, gravity_m_s2, pushes, dead));
}

auto universal_curve(const InMatrix& upsilon, const InVector& friction_rad) {
    require(upsilon.shape(0) == friction_rad.shape(0) && upsilon.shape(1) > 0, "give (B, N), N > 0, and (B,)");
    Array<double, 3> curve(3, upsilon.shape(0), upsilon.shape(1));
    unlocked([&] { antenna::universal_curve(view(upsilon), view(friction_rad), curve); });
    return to_numpy(std::move(curve));
}

auto jacobi(double u, double m) {
    auto found = antenna::jacobi_at(u, antenna::landen(m));
    return std::make_tuple(found.sn, found.cn, found.dn, found.second);
}

void check_loads(const InMatrix& loads, const InMatrix& moment_Nm, int steps) {
    require(loads.shape(1) == 7 && moment_Nm.shape(0) == loads.shape(0) && moment_Nm.shape(1) == 3 && steps > 0 &&
                steps <= MOST_STEPS,
            "rods need loads (B, 7), moments (B, 3) and 1 to 10000 steps");
}

auto solve_rods(nb::handle rod, const InMatrix& loads, double unit_Nm, const InMatrix& limit_Nm,
                const InMatrix& moment_Nm, int steps) {
    check_loads(loads, moment_Nm, steps);
    require(limit_Nm.shape(0) == loads.shape(0) && limit_Nm.shape(1) == 2, "rods need limits (B, 2)");
    antenna::Rod numbers = rod_of(rod);
    auto rods = unlocked(
        [&] { return antenna::solve_rods(numbers, view(loads), unit_Nm, view(limit_Nm), view(moment_Nm), steps); });
    return arrays(rods.nodes, rods.moment_Nm, rods.left);
}

auto shoot_rods(nb::handle rod, const InMatrix& loads, const InMatrix& moment_Nm, int steps) {
    check_loads(loads, moment_Nm, steps);
    antenna::Rod numbers = rod_of(rod);
    return to_numpy(unlocked([&] { return antenna::shoot_rods(numbers, view(loads), view(moment_Nm), steps); }));
}

auto solve_touched_twice(nb::handle rod, const InMatrix& loads, double give_m, const InMatrix& start, int steps) {
    require(loads.shape(1) == 11 && start.shape(0) == loads.shape(0) && start.shape(1) == 5 && steps > 0 &&
                steps <= MOST_STEPS,
            "rods touched twice need loads (B, 11), starts (B, 5) and 1 to 10000 steps");
    antenna::Rod numbers = rod_of(rod);
    require(numbers.slices.empty(), "rods touched twice are uniform");
    auto found =
        unlocked([&] { return antenna::solve_touched_twice(numbers, view(loads), give_m, view(start), steps); });
    return arrays(found.nodes, found.solution, found.left);
}

}  // namespace

void bind_antenna(nb::module_& module) {
    nb::module_ room = module.def_submodule("antenna", "Shapes of the antenna: elastica, rod, closed forms.");
    room.attr("NODES_TO_CONTACT") = antenna::NODES_TO_CONTACT;
    room.attr("NODES_BEYOND") = antenna::NODES_BEYOND;
    room.attr("NODE_ROWS") = NODE_ROWS;
    room.attr("NEAREST_TO_TIP") = antenna::NEAREST_TO_TIP;
    room.attr("STEPS_PER_SEGMENT") = antenna::STEPS_PER_SEGMENT;
    room.attr("ROD_TOLERANCE") = antenna::ROD_TOLERANCE;
    room.def("curves", &curves, "Points, tangents (B, N, 3), force (B, 3) and moment (B,) as a rung sees them.");
    room.def("bend", &bend, "The same by so many sweeps over the equilibrium of moments.");
    room.def("universal_curve", &universal_curve, "psi, C and S (3, B, N) at v (B, N), each row's largest first.");
    room.def("jacobi", &jacobi, "sn, cn, dn of (u | m), and E(am(u | m) | m).");
    room.def("solve_rods", &solve_rods, "Nodes (B, N, 4, 3), clamp moments (B, 3) and what is left of the tips' (B,).");
    room.def("solve_touched_twice", &solve_touched_twice, "Nodes (B, N, 4, 3), solutions (B, 5), what is left (B,).");
    room.def("shoot_rods", &shoot_rods, "Nodes (B, N, 4, 3) from supposed clamp moments.");
}

}  // namespace vbaa
