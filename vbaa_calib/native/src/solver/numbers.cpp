#include "solver/numbers.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "linear_algebra.hpp"
#include "order.hpp"
#include "smooth.hpp"
#include "solver/initialization.hpp"
#include "solver/normal_equations.hpp"
#include "solver/prediction.hpp"

namespace vbaa::solver {
namespace {

// No place is known better: near the clamp the model's own errors are all there is.
constexpr double LEAST_STD_M = 1e-6;

// The point of the predicted antenna at an arc length, antenna frame.
std::array<double, 3> point_at(const Fit& fit, double length_m, double arclength_m) {
    const Place place = locate(fit, length_m, arclength_m);
    std::array<double, 3> point_m;
    for (int axis = 0; axis < 3; ++axis) {
        const double start = fit.points_m[axis][place.node], gap = fit.points_m[axis][place.node + 1] - start;
        const double leave = fit.tangents[axis][place.node] * place.width;
        const double arrive = fit.tangents[axis][place.node + 1] * place.width;
        const double bend = 3.0 * gap - 2.0 * leave - arrive, twist = leave + arrive - 2.0 * gap;
        point_m[axis] = ((twist * place.share + bend) * place.share + leave) * place.share + start;
    }
    return point_m;
}

// Adds the model errors of a demanded rung that is too low to the uncertainty. Writes the standard deviations (4,).
void add_model_errors(const Rig& rig, const Findings& findings, const Uncertainty& found, double (&covariance)[6][6],
                      Vector std) {
    const double bias = findings.bias[findings.rung];
    double errors[2][UNKNOWNS + 6] = {};
    if (findings.rung != REFERENCE && bias > SMALL_BIAS && std::isfinite(bias)) {
        std::copy_n(findings.errors[findings.rung], UNKNOWNS + 6, errors[0]);
        if (findings.rung < ELASTICA && rig.friction_rad > 0.0) {
            std::copy_n(findings.errors[BY_FRICTION], UNKNOWNS + 6, errors[1]);
            // that friction turns the force along the antenna is in the point and force's own covariance already
            errors[1][UNKNOWNS + 3] = 0.0;
        }
    }
    for (int a = 0; a < UNKNOWNS; ++a) {
        std[a] = std::sqrt(found.covariance[a][a] + errors[0][a] * errors[0][a] + errors[1][a] * errors[1][a]);
    }
    for (int p = 0; p < 6; ++p) {
        for (int q = 0; q < 6; ++q) {
            for (const auto& kind : errors) covariance[p][q] += kind[UNKNOWNS + p] * kind[UNKNOWNS + q];
        }
    }
}

// Adds a part of contact point and force of a linear beam, foreshortened, for distance and force.
void add_touch_of_beam(const Rig& rig, const double (&at)[3], double part, std::array<double, 6>& total) {
    const double distance = at[0] * rig.length_m;
    const double by_force = rig.unit_load * rig.length_m * antenna::deflection(rig.taper, at[0], at[0]);
    const double shift_y = at[1] * by_force, shift_z = at[2] * by_force, near = std::max(distance, 1e-9);
    total[0] += part * (distance - 0.6 * (shift_y * shift_y + shift_z * shift_z) / near);
    total[1] += part * shift_y;
    total[2] += part * shift_z;
    total[3] += part * -1.5 * (at[1] * shift_y + at[2] * shift_z) * rig.force_unit_N / near;
}

// Adds the second order of contact point and force in the unknowns: linear beam, foreshortening, slope.
// A point known badly along a bent antenna is known within a bow, which a thin straight ellipsoid would leave.
void add_bows(const Rig& rig, const Unknowns& unknowns, const Uncertainty& found, double (&total)[6][6]) {
    double part[3][3], sizes[3], axes[3][3];
    for (int a = 0; a < UNKNOWNS; ++a) {
        for (int b = 0; b < UNKNOWNS; ++b) {
            if (!std::isfinite(found.covariance[a][b])) return;
            if (a < 3 && b < 3) part[a][b] = found.covariance[a][b];
        }
    }
    symmetric_eigen(part, sizes, axes);
    std::array<double, 6> middle = {};
    add_touch_of_beam(rig, {unknowns[0], unknowns[1], unknowns[2]}, -2.0, middle);
    for (int k = 0; k < 3; ++k) {
        std::array<double, 6> bow = middle;
        for (double side : {-1.0, 1.0}) {
            double there[3];
            for (int a = 0; a < 3; ++a) there[a] = unknowns[a] + side * axes[a][k] * std::sqrt(std::max(sizes[k], 0.0));
            add_touch_of_beam(rig, there, 1.0, bow);
        }
        for (int p = 0; p < 6; ++p) {
            // the mean square of z²/2 is 3/4
            for (int q = 0; q < 6; ++q) total[p][q] += 0.75 * bow[p] * bow[q];
        }
    }
}

// By how many px, rms along the antenna, and σ of the readings the rig's own steps move both.
void write_drift(const Rig& rig, const Fit& fit, Numbers& numbers) {
    const auto moved = [&](const double* columns) {
        double total = 0.0;
        for (int k = 0; k < rig.shared; ++k) total += columns[UNKNOWNS + k] * fit.steps[k];
        return total;
    };
    double most = 0.0, farthest_px = 0.0;
    int clamp = 0;
    for (const Camera& camera : rig.cameras) {
        double square = 0.0;
        for (int j = clamp; j < clamp + NODES; ++j) {
            const double shift = moved(fit.columns.row(j).data);
            square += shift * shift;
        }
        farthest_px = std::max(farthest_px, camera.focal * std::sqrt(square / NODES));
        clamp += NODES;
    }
    for (int reading = 0; reading < fit.readings; ++reading) {
        if (reading == END) continue;
        most = std::max(most, std::abs(moved(fit.reading_columns.row(reading).data)));
    }
    numbers.drift_px = farthest_px;
    numbers.drift_readings = most;
}

// Points of the fitted antenna at the pieces, antenna frame, and their σ by one frame's noise: from frame to frame, for
// the rig as it is, of the linear beam, since the rig's errors are the same in all.
void write_pieces(const Rig& rig, const Fit& fit, ConstVector pieces_m, Numbers& numbers, Work& work) {
    const double contact = fit.unknowns[0], unit_m = rig.unit_load * rig.length_m;
    factorise(fit.information, 0, UNKNOWNS, 0.0, work.factor, work.scale);
    for (int g = 0; g < PIECES; ++g) {
        const double at = pieces_m[g], along = at / rig.length_m;
        const double by_force = unit_m * antenna::deflection(rig.taper, along, contact);
        const double by_distance = unit_m * antenna::deflection_by_contact(rig.taper, along, contact);
        const std::array<double, 3> point_m = point_at(fit, rig.length_m, at);
        std::copy(point_m.begin(), point_m.end(), numbers.pieces_m[g]);
        double total = 0.0;
        for (int axis = 1; axis < 3; ++axis) {
            Unknowns slopes = {fit.unknowns[axis] * by_distance}, moved;
            slopes[axis] = by_force;
            solve_factorised(work.factor, work.scale, UNKNOWNS, slopes.data(), moved.data());
            for (int a = 0; a < UNKNOWNS; ++a) total += slopes[a] * moved[a];
        }
        numbers.pieces_std_m[g] = std::sqrt(std::max(total, LEAST_STD_M * LEAST_STD_M));
    }
}

// How far a load of 1 N/m on each piece, along y and z, would move the distance, in σ.
void write_push(const Rig& rig, const Frame& frame, ConstVector pieces_m, double distance_std, Numbers& numbers,
                Work& work) {
    const Fit& fit = work.best;
    const double width = rig.length_m / PIECES, unit = rig.unit_load / rig.force_unit_N * rig.length_m * width;
    double place[PIECES], tip_m[PIECES], force_N[PIECES], lever[PIECES], readings[READINGS][2 * PIECES];
    double moved[PIECES][2] = {};
    for (int g = 0; g < PIECES; ++g) {
        place[g] = pieces_m[g] / rig.length_m, tip_m[g] = unit * antenna::deflection(rig.taper, TIP, place[g]);
        force_N[g] = width, lever[g] = pieces_m[g] * width;
    }
    const Array<double, 2> image = point_jacobian(rig, fit);
    push_readings(rig, frame, fit, {view(tip_m), view(force_N), view(lever)}, view(readings));
    factorise(fit.information, 0, fit.size, 0.0, work.factor, work.scale);
    // only the distance's response to each load is needed: the first row of the inverse
    double* response = work.step.begin();
    fill(work.step.view(), 0.0);
    response[0] = 1.0;
    solve_factorised(work.factor, work.scale, fit.size, response, response);
    shift_by_steps(fit, 0, response, fit.size, work.shift);
    for (int j = 0; j < NODES; ++j) {
        double pull[2] = {};
        for (int node = j; node < fit.nodes; node += NODES) {
            double weighted = fit.diagonal[node] * work.shift[node];
            if (j > 0) weighted += fit.off_diagonal[node - 1] * work.shift[node - 1];
            if (j < LAST) weighted += fit.off_diagonal[node] * work.shift[node + 1];
            for (int axis = 0; axis < 2; ++axis) pull[axis] += unit * weighted * image(axis, node);
        }
        const double along = arclength_of_node(fit, rig.length_m, j) / rig.length_m;
        for (int g = 0; g < PIECES; ++g) {
            const double bent = antenna::deflection(rig.taper, along, place[g]);
            for (int axis = 0; axis < 2; ++axis) moved[g][axis] += bent * pull[axis];
        }
    }
    for (int k = 0; k < fit.readings; ++k) {
        double pull = 0.0;
        for (int a = 0; a < fit.size; ++a)
            pull += huber_weight(fit.residual[k]) * response[a] * fit.reading_columns(k, a);
        for (int g = 0; g < PIECES; ++g) {
            for (int axis = 0; axis < 2; ++axis) moved[g][axis] += pull * readings[k][2 * g + axis];
        }
    }
    for (int g = 0; g < PIECES; ++g) {
        for (int axis = 0; axis < 2; ++axis) numbers.push[g][axis] = moved[g][axis] / distance_std;
    }
}

// Contact point, force and their covariances.
void write_touch(const Rig& rig, const Uncertainty& found, const Findings& findings, Numbers& numbers,
                 const Work& work) {
    const Fit& fit = work.best;
    const Marginal& marginal = findings.marginal;
    const int shared = rig.shared, steps = fit.size - UNKNOWNS;
    double covariance[6][6], by_distance = 0.0;
    touch_covariance(found, covariance);
    const auto& own = marginal.known ? marginal.fixed : found.covariance;
    // change of a result by a unit error along each of the rig's axes, which all frames share
    Array<double, 2> with_rig(6, shared);
    for (int k = 0; k < shared; ++k) {
        Unknowns response = {};
        for (int a = 0; a < UNKNOWNS; ++a) {
            for (int b = 0; b < UNKNOWNS; ++b) response[a] += own[a][b] * found.rig_response(k, b);
        }
        by_distance += response[0] * response[0];
        for (int q = 0; q < 6; ++q) {
            double turned = found.rig_touch(k, q);
            for (int a = 0; a < UNKNOWNS; ++a) turned += found.touch[q][a] * response[a];
            with_rig(q, k) = turned;
        }
    }
    numbers.shared_std = std::sqrt(by_distance);
    if (!fit.at_tip) add_bows(rig, fit.unknowns, found, covariance);
    if (marginal.known) std::copy_n(marginal.touch_covariance[0], 36, covariance[0]);
    add_model_errors(rig, findings, found, covariance, view(numbers.std));
    const double distance = marginal.known ? marginal.mean[0] : fit.unknowns[0];
    const std::array<double, 3> free_point = point_at(work.free, rig.length_m, distance * rig.length_m);
    for (int q = 0; q < 6; ++q) {
        double touch = fit.point_force[q];
        for (int k = 0; k < steps; ++k) touch += fit.point_force_columns(q, UNKNOWNS + k) * fit.steps[k];
        if (marginal.known) touch = marginal.touch[q];
        (q < 3 ? numbers.point_m : numbers.force_N)[q % 3] = touch;
        if (q < 3) {
            numbers.deflection_m[q] = touch - free_point[q];
            numbers.tangent[q] = fit.tangents[q][CONTACT];
        }
        for (int p = 0; p < 6; ++p) {
            double pose = 0.0, both = 0.0;
            for (int k = 0; k < shared; ++k) {
                pose += with_rig(q, k) * rig.axes(p, k);
                both += with_rig(q, k) * with_rig(p, k);
            }
            numbers.covariance[q][p] = covariance[q][p];
            numbers.with_pose[q][p] = pose;
            numbers.shared[q][p] = both;
        }
    }
}

// Largest difference of the median distances of points next to each other along one camera's line, in their deviations.
double largest_jump(const Frame& frame, const Fit& fit, int clamp) {
    std::vector<std::pair<double, double>> along;  // arc length and distance
    std::vector<double> precision;
    for (int i = 0; i < fit.points; ++i) {
        if (frame.clamp[i] != clamp) continue;
        along.emplace_back(fit.foot_m[i], fit.distance[i]);
        precision.push_back(fit.precision[i]);
    }
    const int count = static_cast<int>(along.size()), side = std::min(PointSettings().side, std::max(count / 12, 4));
    if (count < 4 * side) return 0.0;
    std::sort(along.begin(), along.end());
    Array<double, 1> distance(count);
    for (int i = 0; i < count; ++i) distance[i] = along[i].second;
    const Array<double, 1> medians = running_medians(distance, side);
    double most = 0.0;
    for (int i = side; i < medians.size(); ++i) most = std::max(most, std::abs(medians[i] - medians[i - side]));
    return most * std::sqrt(nth_smallest(precision, count / 2));
}

}  // namespace

void write_numbers(const Task& task, const Uncertainty& found, const Findings& findings, ConstVector pieces_m,
                   Numbers& numbers) {
    const auto& [rig, frame, rung, work] = task;
    const Fit& fit = work.best;
    const Marginal& marginal = findings.marginal;
    const Unknowns& unknowns = marginal.known ? marginal.mean : fit.unknowns;
    write_touch(rig, found, findings, numbers, work);
    write_drift(rig, fit, numbers);
    numbers.points = fit.points;
    numbers.evaluations = work.evaluations;
    const double distance_std = std::sqrt(found.covariance[0][0]);
    const double friction = found.covariance[0][3] / (distance_std * std::sqrt(found.covariance[3][3]));
    numbers.friction_share = friction * friction;
    const bool with_end = frame.available[END] > 0.0 && findings.left_px != findings.left_px;
    numbers.tip_std = with_end ? fit.residual[END] / found.reading_std[END] : NOT_KNOWN;
    numbers.cost = fit.cost;
    bool finite = std::isfinite(fit.cost);
    for (int a = 0; a < UNKNOWNS; ++a) {
        numbers.unknowns[a] = unknowns[a];
        numbers.alternative_unknowns[a] = findings.other.unknowns[a];
        finite = finite && std::isfinite(unknowns[a]);
    }
    numbers.finite = finite;
    for (int reading = 0; reading < READINGS; ++reading) {
        if (reading == END) continue;
        const int column = reading - (reading > END);
        numbers.residual[column] = fit.residual[reading];
        numbers.residual_std[column] = found.reading_std[reading];
        numbers.sensor_available[column] = frame.available[reading] > 0.0;
    }
    double chi_square = 0.0, largest = 0.0;
    numbers.farthest_camera = frame.seen_by;
    for (double step : fit.steps) chi_square += step * step;
    for (int i = 0; i < fit.points; ++i) {
        const double square = fit.distance[i] * fit.distance[i] * fit.precision[i];
        if (!(square > largest)) continue;
        largest = square;
        numbers.farthest_camera = frame.clamp[i] / NODES;
    }
    numbers.rig_chi_square = chi_square;
    numbers.converged = fit.converged;
    numbers.at_tip = fit.at_tip;
    numbers.scatter = fit.scatter;
    numbers.condition = found.condition;
    numbers.evidence = findings.evidence;
    numbers.alternative_cost = findings.other.cost;
    numbers.second_gain = findings.second.gain;
    numbers.second_place = findings.second.place;
    numbers.second_shift = findings.second.shift;
    numbers.ambiguous = findings.ambiguous;
    numbers.marginal = marginal.known;
    std::copy_n(findings.bias, REFERENCE + 1, numbers.bias);
    numbers.farthest = std::sqrt(largest);
    const int seen_by = static_cast<int>(numbers.farthest_camera) * NODES;
    numbers.jump = numbers.farthest > PointSettings().stretch_std ? largest_jump(frame, fit, seen_by) : 0.0;
    numbers.outliers = 0;
    numbers.edge_on_rad = angle_edge_on(rig, rig.cameras[frame.seen_by], unknowns.data());
    for (int i = 1; i < frame.count; ++i) {
        if (frame.clamp[i] == frame.clamp[i - 1]) continue;
        const double angle = angle_edge_on(rig, rig.cameras[frame.clamp[i] / NODES], unknowns.data());
        numbers.edge_on_rad = std::max(numbers.edge_on_rad, angle);
    }
    numbers.rung = findings.needed;
    numbers.left_px = findings.left_px;
    if (pieces_m.size()) {
        write_pieces(rig, fit, pieces_m, numbers, work);
        write_push(rig, frame, pieces_m, distance_std, numbers, work);
    } else {
        fill(view(numbers.pieces_m), NOT_KNOWN);
        fill(view(numbers.pieces_std_m), NOT_KNOWN);
        fill(view(numbers.push), NOT_KNOWN);
    }
}

double angle_edge_on(const Rig& rig, const Camera& camera, const double* unknowns) {
    const double x = camera.eye_m[0] - unknowns[0] * rig.length_m, y = camera.eye_m[1], z = camera.eye_m[2];
    const double roll = std::atan2(unknowns[2], unknowns[1]);
    const double height = std::cos(roll) * z - std::sin(roll) * y;
    return std::atan2(std::abs(height), std::sqrt(std::max(x * x + y * y + z * z - height * height, 0.0)));
}

}  // namespace vbaa::solver
