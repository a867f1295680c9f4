#include "solver/report.hpp"

#include <algorithm>
#include <cmath>

#include "solver/convergence.hpp"
#include "solver/initialization.hpp"

namespace vbaa::solver {
namespace {

bool any_reading(const Numbers& n) {
    for (bool each : n.sensor_available) {
        if (each) return true;
    }
    return false;
}

// Largest residual of a reading in its expected σ; NaN where one is NaN.
double disagreement(const Numbers& n) {
    double most = 0.0;
    for (int k = 0; k < READINGS - 1; ++k) {
        const double size = std::abs(n.residual[k]) / n.residual_std[k];
        if (!(size <= most)) most = size;
        if (most != most) break;
    }
    return most;
}

// Distance to the least one searched, in antenna lengths, within which the true contact may be nearer.
constexpr double NEAR_CLAMP = 0.005;

// Whether the force along an axis is known to half of its size.
bool force_known(const Numbers& n, int axis) {
    const double force = std::hypot(n.unknowns[1], n.unknowns[2]);
    return n.std[axis] < 0.5 * force || !n.marginal;
}

// Whether another contact, apart by more than the uncertainty, explains the frame about equally well.
bool is_ambiguous(const Numbers& n, const Limits& limits) {
    if (!(n.alternative_cost < limits.alternative_cost * n.scatter * n.scatter)) return false;
    for (int a = 0; a < 3; ++a) {
        if (std::abs(n.alternative_unknowns[a] - n.unknowns[a]) > 3.0 * n.std[a]) return true;
    }
    return false;
}

bool force_unknown(const Numbers& n, const Limits& limits) {
    const double distance = n.unknowns[0], std = std::max(n.std[1], n.std[2]);
    const bool known = n.std[1] == n.std[1] && n.std[2] == n.std[2];
    const double at_tip = 0.01 * distance * distance * distance * std;
    return !(known && at_tip < limits.low_signal) && !n.marginal;
}

bool out_of_ordinary(const Numbers& n, const Limits& limits) {
    bool noticed = !force_known(n, 1) || !force_known(n, 2) || n.scatter > 1.0;
    noticed = noticed || std::abs(n.tip_std) > limits.disagreement;
    noticed = noticed || n.friction_share > limits.friction_share;
    // the mean of χ²; noticeable values lie far above
    noticed = noticed || n.rig_chi_square > std::max(static_cast<double>(n.rig_axes), 1.0);
    for (int k = 0; k < READINGS - 1; ++k) {
        noticed = noticed || std::abs(n.residual[k]) > limits.disagreement * n.residual_std[k];
    }
    return noticed;
}

std::uint64_t noticed_of(const Numbers& n, const Limits& limits) {
    const double friction = std::abs(n.unknowns[UNKNOWNS - 1]), bias = n.bias[n.rung];
    const bool mirrored = n.ambiguous && (n.marginal || !any_reading(n));
    // without it a distance that may be anywhere counts as too uncertain, not as too near
    const double least = n.unknowns[0] - std::max(NEAR_CLAMP, n.marginal ? n.std[0] : 0.0);
    const bool at_clamp = least <= NEAREST, too_steep = friction > limits.steepest;
    const bool twice = n.second_gain > limits.second_contact && n.second_shift > limits.second_shift;
    // without a reading a steep bend along the line of sight fits almost anything, if not quite
    const bool blind = mirrored && (n.scatter > 1.0 || friction > limits.steepest_blind);
    const bool wrong = !n.converged || n.scatter > WRONG_SHAPE || blind;
    std::uint64_t found = 0;
    const auto note = [&](Noticed one, bool is) { found |= is ? static_cast<std::uint64_t>(one) : 0; };
    note(MIRRORED, mirrored);
    note(AT_CLAMP, at_clamp);
    note(TOO_STEEP, too_steep);
    note(TWICE_TOUCHED, twice);
    note(UNEXPLAINED, wrong || at_clamp || too_steep || twice);
    note(MODEL_TOO_LOW, std::isfinite(bias) && bias > limits.highest_bias);
    note(FORCE_UNKNOWN, force_unknown(n, limits));
    note(OUT_OF_ORDINARY, out_of_ordinary(n, limits));
    const bool touched = n.evidence >= limits.contact_evidence,
               off = n.farthest > limits.outlying_std || n.jump > limits.jump;
    note(DOUBTED, off || std::abs(n.tip_std) > limits.outlying_end || (touched && (found & UNEXPLAINED) != 0));
    return found;
}

Status status_of(const Numbers& n, const Limits& limits, std::uint64_t noticed) {
    const double std = n.std[0], relative = limits.low_signal_relative * n.unknowns[0];
    const bool uncertain = !(std < limits.low_signal && std < relative), mirrored = (noticed & MIRRORED) != 0;
    // a fit that stopped somewhere says nothing about whether there is a contact
    const bool stopped = !n.converged && n.scatter > WRONG_SHAPE;
    if (n.points < limits.fewest_points) return Status::NO_ANTENNA;
    if (!n.finite || std::isfinite(n.left_px)) return Status::FAILED;
    if (!(n.evidence >= limits.contact_evidence) && !stopped) return Status::NO_CONTACT;
    if (n.edge_on_rad < limits.edge_on_rad && (uncertain || !n.converged)) return Status::UNOBSERVABLE;
    if (mirrored && n.edge_on_rad < limits.edge_on_blind_rad) return Status::UNOBSERVABLE;
    if ((noticed & UNEXPLAINED) != 0 || (noticed & MODEL_TOO_LOW) != 0) return Status::FAILED;
    if (uncertain && std::isfinite(std)) return Status::LOW;
    if (uncertain || (noticed & FORCE_UNKNOWN) != 0 || is_ambiguous(n, limits)) return Status::UNOBSERVABLE;
    if (disagreement(n) > limits.contradiction) return Status::FAILED;
    return n.at_tip ? Status::AT_TIP : Status::OK;
}

// A vector x of a frame rotated into the world.
std::array<double, 3> turned(const Placed& placed, int b, const double (&x)[3]) {
    std::array<double, 3> found;
    for (int i = 0; i < 3; ++i) {
        found[i] = placed.rotation(b, i, 0) * x[0] + placed.rotation(b, i, 1) * x[1] + placed.rotation(b, i, 2) * x[2];
    }
    return found;
}

// (R C Rᵀ)ᵢⱼ of the upper left block of a covariance.
double turned(const Placed& placed, int b, const double (&covariance)[6][6], int i, int j) {
    double total = 0.0;
    for (int p = 0; p < 3; ++p) {
        for (int q = 0; q < 3; ++q) total += placed.rotation(b, i, p) * covariance[p][q] * placed.rotation(b, j, q);
    }
    return total;
}

void report_place(const Numbers& n, int b, const Placed& placed, bool located, Reported& to) {
    const auto known = [located](double value) { return located ? value : NOT_KNOWN; };
    to.distance_m = known(n.unknowns[0] * placed.length_m);
    to.distance_std_m = known(n.std[0] * placed.length_m);
    to.distance_shared_std_m = known(n.shared_std * placed.length_m);
    to.friction_angle_rad = known(n.unknowns[3] * placed.friction_rad);
    to.friction_angle_std_rad = known(n.std[3] * placed.friction_rad);
    const std::array<double, 3> point = turned(placed, b, n.point_m);
    for (int i = 0; i < 3; ++i) {
        to.point_antenna_m[i] = known(n.point_m[i]);
        to.point_world_m[i] = known(point[i] + placed.translation_m(b, i));
        to.point_shared_std_m[i] = known(std::sqrt(turned(placed, b, n.shared, i, i)));
        for (int j = 0; j < 3; ++j) to.covariance_world_m2[i][j] = known(turned(placed, b, n.covariance, i, j));
    }
}

// Writes the force; of one that is not known in all directions only quantities that do not mix its components.
void report_force(const Numbers& n, int b, const Placed& placed, bool located, Reported& to) {
    // the force's rows of a covariance follow the point's three
    const auto of_force = [](const double (&covariance)[6][6], int i, int j) { return covariance[3 + i][3 + j]; };
    const bool by_axis[] = {true, force_known(n, 1), force_known(n, 2)};
    const bool whole = located && by_axis[1] && by_axis[2];
    const auto in_all = [whole](double value) { return whole ? value : NOT_KNOWN; };
    const std::array<double, 3> force = turned(placed, b, n.force_N), along = turned(placed, b, n.tangent);
    to.force_covariance_yz_N2 = in_all(of_force(n.covariance, 1, 2));
    for (int i = 0; i < 3; ++i) {
        const bool own = i == 0 ? whole : located && by_axis[i];
        const auto alone = [own](double value) { return own ? value : NOT_KNOWN; };
        to.force_N[i] = alone(n.force_N[i]);
        to.force_std_N[i] = alone(std::sqrt(of_force(n.covariance, i, i)));
        to.deflection_m[i] = alone(n.deflection_m[i]);
        to.force_shared_std_N[i] = in_all(std::sqrt(of_force(n.shared, i, i)));
        to.force_world_N[i] = in_all(force[i]);
        to.tangent_world[i] = in_all(along[i]);
    }
}

}  // namespace

void judge(View<const Numbers, 1> numbers, const Limits& limits, const Judged& found) {
    for (int b = 0; b < numbers.size(); ++b) {
        found.noticed[b] = noticed_of(numbers[b], limits);
        found.status[b] = static_cast<std::int64_t>(status_of(numbers[b], limits, found.noticed[b]));
    }
}

void report(View<const Numbers, 1> numbers, const Judged& judged, const Placed& placed, View<Reported, 1> rows) {
    for (int b = 0; b < numbers.size(); ++b) {
        const Numbers& n = numbers[b];
        Reported& to = rows[b];
        const auto status = static_cast<Status>(judged.status[b]);
        const bool located = status == Status::OK || status == Status::AT_TIP;
        report_place(n, b, placed, located, to);
        report_force(n, b, placed, located, to);
        to.in_contact = n.finite && status != Status::NO_ANTENNA && status != Status::NO_CONTACT;
        to.evidence = n.finite ? n.evidence : NOT_KNOWN;
        to.moment_residual_Nm = n.sensor_available[0] ? n.residual[0] * placed.moment_Nm : NOT_KNOWN;
    }
}

}  // namespace vbaa::solver
