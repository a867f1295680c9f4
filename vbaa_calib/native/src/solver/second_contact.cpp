#include "solver/second_contact.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "linear_algebra.hpp"
#include "order.hpp"
#include "solver/initialization.hpp"
#include "solver/normal_equations.hpp"
#include "solver/prediction.hpp"

namespace vbaa::solver {
namespace {

// Places of the other force, evenly over the antenna, and its components there.
constexpr int PLACES = 16, FORCES = 2 * PLACES;
// Stretches of the antenna over which residuals are summed, and the χ² of the sums beyond which a second force is
// searched: one frame of noise in 200.
constexpr int BLOCKS = 8;
constexpr double STRUCTURE = 22.0;
// A force is ignored if the first contact and the rig explain all but this part of its deflection's square.
constexpr double DEPENDENT = 1e-4;

// Sum of squares of the residuals' means over BLOCKS stretches of a picture from its first node on, in their σ: χ² if
// all is noise.
double structure(const Fit& problem, int clamp) {
    constexpr int WIDTH = NODES / BLOCKS;
    double total = 0.0;
    for (int block = 0; block < BLOCKS; ++block) {
        double pull = 0.0, weight = 0.0;
        const int begin = clamp + NODES - (BLOCKS - block) * WIDTH;
        for (int j = begin; j < begin + WIDTH; ++j) {
            // the nodes' hat functions add up to one, so that a row's sum is the weight of its node
            pull += problem.pull[j];
            weight +=
                problem.diagonal[j] + (j - clamp < LAST ? problem.off_diagonal[j] : 0.0) + problem.off_diagonal[j - 1];
        }
        total += pull * pull / std::max(weight, 1e-30);
    }
    return total;
}

struct Force {
    double y, z, lowers;
};

// The best force at a place, in its columns' units, and how much it lowers the cost.
// own: its information yy, yz, zz; left: what contact and rig leave of it. y, z: the right side.
Force best_force(const double (&own)[3], const double (&left)[3], double y, double z) {
    const double least = DEPENDENT * (own[0] + own[2]) + 1e-30;
    const double middle = 0.5 * (left[0] + left[2]), half = std::hypot(0.5 * (left[0] - left[2]), left[1]);
    const double angle = 0.5 * std::atan2(left[1], 0.5 * (left[0] - left[2]));
    const double cos = std::cos(angle), sin = std::sin(angle);
    const double along = cos * y + sin * z, across = cos * z - sin * y;
    const double major = middle + half > least ? along / std::max(middle + half, 1e-300) : 0.0;
    const double minor = middle - half > least ? across / std::max(middle - half, 1e-300) : 0.0;
    return {cos * major - sin * minor, sin * major + cos * minor, 0.5 * (major * along + minor * across)};
}

// Factor on the points' σ by which neighbours along the antenna differ, at least 1.
// A second contact leaves smooth residuals: the scatter about the fit would take them for noise.
double neighbour_scatter(const Fit& fit) {
    const int count = fit.points;
    if (count < 2) return 1.0;
    std::vector<int> order(count);
    std::iota(order.begin(), order.end(), 0);
    const auto place = [&](int i) { return std::pair(fit.node[i] / NODES, fit.foot_m[i]); };
    std::sort(order.begin(), order.end(), [&](int a, int b) { return place(a) < place(b); });
    const auto whitened = [&](int i) { return fit.distance[i] * std::sqrt(fit.precision[i]); };
    std::vector<double> gaps(count - 1);
    for (int i = 0; i < count - 1; ++i) gaps[i] = std::abs(whitened(order[i + 1]) - whitened(order[i]));
    const double median = nth_smallest(gaps, (count - 1) / 2);
    return std::max(MAD_SCALE / std::sqrt(2.0) * median, 1.0);
}

// Forces at PLACES: their columns, and the part of these that contact, friction and rig explain.
struct Forces {
    double readings[READINGS][FORCES], side[FORCES] = {};
    Array<double, 2> columns, weighted;   // (M, FORCES)
    Array<double, 2> crossed, explained;  // (FORCES, K) sums with the fit's columns, and their solutions
};

// The deflections by small forces at all places, scaled to a metre at the tip.
void small_forces(const Rig& rig, const Frame& frame, const Fit& fit, Forces& forces) {
    const double contact = std::min(fit.contact_m / rig.length_m, 1.0 - 1e-6);
    double lever[PLACES], force_N[PLACES], bent[NODES][PLACES];
    for (int g = 0; g < PLACES; ++g) {
        const double place = (g + 1.0) / PLACES;
        const double tip = antenna::deflection(rig.taper, TIP, place);
        lever[g] = rig.stiffness_Nm2 * place / (tip * rig.length_m * rig.length_m);
        force_N[g] = lever[g] / (place * rig.length_m);
        for (int j = 0; j < NODES; ++j) {
            const double along = j < NODES_TO_CONTACT
                                     ? contact * j / (NODES_TO_CONTACT - 1)
                                     : contact + (1.0 - contact) * (j - NODES_TO_CONTACT + 1) / NODES_BEYOND;
            bent[j][g] = antenna::deflection(rig.taper, along, place) / tip;
        }
    }
    forces.columns = forces.weighted = Array<double, 2>(fit.nodes, FORCES);
    const Array<double, 2> image = point_jacobian(rig, fit);
    for (int j = 0; j < fit.nodes; ++j) {
        for (int k = 0; k < FORCES; ++k) forces.columns(j, k) = bent[j % NODES][k / 2] * image(k % 2, j);
    }
    push_readings(rig, frame, fit, {view(bent[LAST]), view(force_N), view(lever)}, view(forces.readings));
}

// Products of the forces with the residuals and the fit's columns, and the part that these columns explain.
void project_out(const Fit& fit, const double (&weight)[READINGS], Work& work, Forces& forces) {
    const int size = fit.size;
    forces.crossed = forces.explained = Array<double, 2>(FORCES, size);
    times_tridiagonal(fit, forces.columns, forces.weighted);
    factorise(fit.information, 0, size, 0.0, work.factor, work.scale);
    solve_factorised(work.factor, work.scale, size, fit.side.begin(), work.step.begin());
    for (int k = 0; k < FORCES; ++k) {
        double* crossed = forces.crossed.row(k).data;
        for (int j = 0; j < fit.nodes; ++j) {
            forces.side[k] += forces.columns(j, k) * fit.pull[j];
            for (int a = 0; a < size; ++a) crossed[a] += forces.weighted(j, k) * fit.columns(j, a);
        }
        for (int reading = 0; reading < fit.readings; ++reading) {
            const double pull = weight[reading] * forces.readings[reading][k];
            forces.side[k] += pull * fit.residual[reading];
            for (int a = 0; a < size; ++a) crossed[a] += pull * fit.reading_columns(reading, a);
        }
        for (int a = 0; a < size; ++a) forces.side[k] -= crossed[a] * work.step[a];
        solve_factorised(work.factor, work.scale, size, crossed, forces.explained.row(k).data);
    }
}

// Gain, place and shift of the best second force, by its small deflection, with the part that contact, friction and rig
// explain projected out.
SecondForce score_test(const Rig& rig, const Frame& frame, const Fit& fit, double distance_std, Work& work) {
    Forces forces;
    small_forces(rig, frame, fit, forces);
    double weight[READINGS];
    for (int reading = 0; reading < fit.readings; ++reading) weight[reading] = huber_weight(fit.residual[reading]);
    project_out(fit, weight, work, forces);
    int most = 0;
    Force best = {0.0, 0.0, -std::numeric_limits<double>::infinity()};
    for (int g = 0; g < PLACES; ++g) {
        double own[3] = {}, left[3];
        for (int pair = 0; pair < 3; ++pair) {
            const int a = 2 * g + (pair == 2), b = 2 * g + (pair > 0);
            for (int j = 0; j < fit.nodes; ++j) own[pair] += forces.columns(j, a) * forces.weighted(j, b);
            for (int reading = 0; reading < fit.readings; ++reading) {
                own[pair] += weight[reading] * forces.readings[reading][a] * forces.readings[reading][b];
            }
            left[pair] = own[pair];
            for (int k = 0; k < fit.size; ++k) left[pair] -= forces.crossed(a, k) * forces.explained(b, k);
        }
        const Force force = best_force(own, left, forces.side[2 * g], forces.side[2 * g + 1]);
        if (force.lowers > best.lowers) {
            most = g;
            best = force;
        }
    }
    const double moved = best.y * forces.explained(2 * most, 0) + best.z * forces.explained(2 * most + 1, 0);
    const double rescaled = fit.scatter / neighbour_scatter(fit);
    return {best.lowers * rescaled * rescaled, (most + 1.0) / PLACES, std::abs(moved) / distance_std};
}

}  // namespace

SecondForce second_force(const Task& task, const Fit& fit, const Fit& problem, double distance_std) {
    const auto& [rig, frame, rung, work] = task;
    bool structured = fit.scatter > 1.0;
    for (int clamp = 0; clamp < fit.nodes; clamp += NODES) {
        structured = structured || structure(problem, clamp) > STRUCTURE;
    }
    if (!structured) return {};
    work.other = fit;
    if (rung != REFERENCE) evaluate(rig, frame, REFERENCE, work.other, work);
    return score_test(rig, frame, work.other, distance_std, work);
}

void push_readings(const Rig& rig, const Frame& frame, const Fit& fit, const Pushes& pushes, Matrix readings) {
    const auto& [tip_m, force_N, lever] = pushes;
    const int places = lever.size();
    // the picture's direction at the end
    const int tip = frame.tip_clamp + LAST;
    const auto& turn = rig.cameras[frame.tip_clamp / NODES].rotation;
    const TipAxis end = tip_axis(frame, fit.normal_v[tip], -fit.normal_u[tip]);
    const double ahead = end.u * fit.u[tip] + end.v * fit.v[tip];
    for (int axis = 0; axis < 2; ++axis) {
        const double along = end.u * turn[0][1 + axis] + end.v * turn[1][1 + axis] - ahead * turn[2][1 + axis];
        for (int g = 0; g < places; ++g) {
            const int k = 2 * g + axis;
            for (int reading = 0; reading < rig.readings; ++reading) {
                const auto& row = rig.by_wrench[reading];
                const double turns = (axis == 0 ? row[5] : -row[4]) * lever[g], pulls = row[1 + axis] * force_N[g];
                readings(reading, k) = (turns + pulls) * frame.available[reading];
            }
            readings(END, k) = tip_m[g] * along / fit.depth[tip] * frame.available[END];
        }
    }
}

}  // namespace vbaa::solver
