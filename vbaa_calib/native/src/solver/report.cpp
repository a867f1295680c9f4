#include "solver/report.hpp"

#include <algorithm>
#include <cmath>

#include "solver/convergence.hpp"
#include "solver/initialization.hpp"

namespace vbaa::solver {
namespace {

bool any_reading(const Numbers& n, int b) {
    for (bool each : n.sensor_available.row(b)) {
        if (each) return true;
    }
    return false;
}

// Largest residual of a reading in its expected deviations; NaN where one is.
double disagreement(const Numbers& n, int b) {
    double most = 0.0;
    for (int k = 0; k < READINGS - 1; ++k) {
        const double size = std::abs(n.residual(b, k)) / n.residual_std(b, k);
        if (!(size <= most)) most = size;
        if (most != most) break;
    }
    return most;
}

// Whether the force along an axis is known to half of its size.
bool force_known(const Numbers& n, int b, int axis) {
    const double force = std::hypot(n.unknowns(b, 1), n.unknowns(b, 2));
    return n.std(b, axis) < 0.5 * force || !n.marginal[b];
}

// Whether another contact, apart by more than the uncertainty, explains the frame about equally well.
bool is_ambiguous(const Numbers& n, int b, const Limits& limits) {
    if (!(n.alternative_cost[b] < limits.alternative_cost * n.scatter[b] * n.scatter[b])) return false;
    for (int a = 0; a < 3; ++a) {
        if (std::abs(n.alternative_unknowns(b, a) - n.unknowns(b, a)) > 3.0 * n.std(b, a)) return true;
    }
    return false;
}

bool force_unknown(const Numbers& n, int b, const Limits& limits) {
    const double distance = n.unknowns(b, 0), std = std::max(n.std(b, 1), n.std(b, 2));
    const bool known = n.std(b, 1) == n.std(b, 1) && n.std(b, 2) == n.std(b, 2);
    const double at_tip = 0.01 * distance * distance * distance * std;
    return !(known && at_tip < limits.low_signal) && !n.marginal[b];
}

bool out_of_ordinary(const Numbers& n, int b, const Limits& limits) {
    bool noticed = !force_known(n, b, 1) || !force_known(n, b, 2) || n.scatter[b] > 1.0;
    noticed = noticed || std::abs(n.tip_std[b]) > limits.disagreement;
    noticed = noticed || n.friction_share[b] > limits.friction_share;
    // its mean; what is noticed lies far above
    noticed = noticed || n.rig_chi_square[b] > std::max(static_cast<double>(n.rig_axes[b]), 1.0);
    for (int k = 0; k < READINGS - 1; ++k) {
        noticed = noticed || std::abs(n.residual(b, k)) > limits.disagreement * n.residual_std(b, k);
    }
    return noticed;
}

std::uint64_t noticed_of(const Numbers& n, int b, const Limits& limits) {
    const double friction = std::abs(n.unknowns(b, UNKNOWNS - 1)), bias = n.bias(b, static_cast<int>(n.rung[b]));
    const double least = n.unknowns(b, 0) - (n.marginal[b] ? n.std(b, 0) : 0.0);
    const bool mirrored = n.ambiguous[b] && (n.marginal[b] || !any_reading(n, b));
    const bool at_clamp = least <= NEAREST * (1.0 + 1e-6), too_steep = friction > limits.steepest;
    const bool twice = n.second_gain[b] > limits.second_contact && n.second_shift[b] > limits.second_shift;
    // without a reading a steep bend along the line of sight fits almost anything, if not quite
    const bool blind = mirrored && (n.scatter[b] > 1.0 || friction > limits.steepest_blind);
    const bool wrong = !n.converged[b] || n.scatter[b] > WRONG_SHAPE || blind;
    std::uint64_t found = 0;
    const auto note = [&](Noticed one, bool is) { found |= is ? static_cast<std::uint64_t>(one) : 0; };
    note(MIRRORED, mirrored);
    note(AT_CLAMP, at_clamp);
    note(TOO_STEEP, too_steep);
    note(TWICE_TOUCHED, twice);
    note(UNEXPLAINED, wrong || at_clamp || too_steep || twice);
    note(MODEL_TOO_LOW, std::isfinite(bias) && bias > limits.highest_bias);
    note(FORCE_UNKNOWN, force_unknown(n, b, limits));
    note(OUT_OF_ORDINARY, out_of_ordinary(n, b, limits));
    return found;
}

Status status_of(const Numbers& n, int b, const Limits& limits, std::uint64_t noticed) {
    const double std = n.std(b, 0), relative = limits.low_signal_relative * n.unknowns(b, 0);
    const bool uncertain = !(std < limits.low_signal && std < relative), mirrored = (noticed & MIRRORED) != 0;
    // a fit that stopped somewhere says nothing about whether there is a contact
    const bool stopped = !n.converged[b] && n.scatter[b] > WRONG_SHAPE;
    if (n.points[b] < limits.fewest_points) return Status::NO_ANTENNA;
    if (!n.finite[b] || std::isfinite(n.left_px[b])) return Status::FAILED;
    if (!(n.evidence[b] >= limits.contact_evidence) && !stopped) return Status::NO_CONTACT;
    if (n.edge_on_rad[b] < limits.edge_on_rad && (uncertain || !n.converged[b])) return Status::UNOBSERVABLE;
    if (mirrored && n.edge_on_rad[b] < limits.edge_on_blind_rad) return Status::UNOBSERVABLE;
    if ((noticed & UNEXPLAINED) != 0 || (noticed & MODEL_TOO_LOW) != 0) return Status::FAILED;
    if (uncertain && std::isfinite(std)) return Status::LOW;
    if (uncertain || (noticed & FORCE_UNKNOWN) != 0 || is_ambiguous(n, b, limits)) return Status::UNOBSERVABLE;
    if (disagreement(n, b) > limits.contradiction) return Status::FAILED;
    return n.at_tip[b] ? Status::AT_TIP : Status::OK;
}

// R x of a frame.
std::array<double, 3> turned(const Placed& placed, int b, ConstVector x) {
    std::array<double, 3> found;
    for (int i = 0; i < 3; ++i) {
        found[i] = placed.rotation(b, i, 0) * x[0] + placed.rotation(b, i, 1) * x[1] + placed.rotation(b, i, 2) * x[2];
    }
    return found;
}

// (R C Rᵀ)ᵢⱼ of the upper left block of a covariance.
double turned(const Placed& placed, int b, const Cube& covariance, int i, int j) {
    double total = 0.0;
    for (int p = 0; p < 3; ++p) {
        for (int q = 0; q < 3; ++q) total += placed.rotation(b, i, p) * covariance(b, p, q) * placed.rotation(b, j, q);
    }
    return total;
}

void report_place(const Numbers& n, int b, const Placed& placed, bool located, const Columns& to) {
    const auto known = [located](double value) { return located ? value : NOT_KNOWN; };
    to.distance_m[b] = known(n.unknowns(b, 0) * placed.length_m);
    to.distance_std_m[b] = known(n.std(b, 0) * placed.length_m);
    to.distance_shared_std_m[b] = known(n.shared_std[b] * placed.length_m);
    to.friction_angle_rad[b] = known(n.unknowns(b, 3) * placed.friction_rad);
    to.friction_angle_std_rad[b] = known(n.std(b, 3) * placed.friction_rad);
    const std::array<double, 3> point = turned(placed, b, n.point_m.row(b));
    for (int i = 0; i < 3; ++i) {
        to.point_antenna_m(b, i) = known(n.point_m(b, i));
        to.point_world_m(b, i) = known(point[i] + placed.translation_m(b, i));
        to.point_shared_std_m(b, i) = known(std::sqrt(turned(placed, b, n.shared, i, i)));
        for (int j = 0; j < 3; ++j) to.covariance_world_m2(b, i, j) = known(turned(placed, b, n.covariance, i, j));
    }
}

// Of a force that is not known in all directions nothing mixes its components.
void report_force(const Numbers& n, int b, const Placed& placed, bool located, const Columns& to) {
    // after the point's three rows of a covariance
    const auto of_force = [b](const Cube& covariance, int i, int j) { return covariance(b, 3 + i, 3 + j); };
    const bool by_axis[] = {true, force_known(n, b, 1), force_known(n, b, 2)};
    const bool whole = located && by_axis[1] && by_axis[2];
    const auto in_all = [whole](double value) { return whole ? value : NOT_KNOWN; };
    const std::array<double, 3> force = turned(placed, b, n.force_N.row(b)),
                                along = turned(placed, b, n.tangent.row(b));
    to.force_covariance_yz_N2[b] = in_all(of_force(n.covariance, 1, 2));
    for (int i = 0; i < 3; ++i) {
        const bool own = i == 0 ? whole : located && by_axis[i];
        const auto alone = [own](double value) { return own ? value : NOT_KNOWN; };
        to.force_N(b, i) = alone(n.force_N(b, i));
        to.force_std_N(b, i) = alone(std::sqrt(of_force(n.covariance, i, i)));
        to.deflection_m(b, i) = alone(n.deflection_m(b, i));
        to.force_shared_std_N(b, i) = in_all(std::sqrt(of_force(n.shared, i, i)));
        to.force_world_N(b, i) = in_all(force[i]);
        to.tangent_world(b, i) = in_all(along[i]);
    }
}

}  // namespace

void judge(const Numbers& numbers, const Limits& limits, const Judged& found) {
    for (int b = 0; b < found.status.size(); ++b) {
        found.noticed[b] = noticed_of(numbers, b, limits);
        found.status[b] = static_cast<std::int64_t>(status_of(numbers, b, limits, found.noticed[b]));
    }
}

void report(const Numbers& numbers, const Judged& judged, const Placed& placed, const Columns& columns) {
    for (int b = 0; b < judged.status.size(); ++b) {
        const auto status = static_cast<Status>(judged.status[b]);
        const bool located = status == Status::OK || status == Status::AT_TIP;
        report_place(numbers, b, placed, located, columns);
        report_force(numbers, b, placed, located, columns);
        columns.in_contact[b] = numbers.finite[b] && status != Status::NO_ANTENNA && status != Status::NO_CONTACT;
        columns.evidence[b] = numbers.finite[b] ? numbers.evidence[b] : NOT_KNOWN;
        columns.moment_residual_Nm[b] =
            numbers.sensor_available(b, 0) ? numbers.residual(b, 0) * placed.moment_Nm : NOT_KNOWN;
    }
}

}  // namespace vbaa::solver
