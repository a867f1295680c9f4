#include "solver/normal_equations.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "linear_algebra.hpp"
#include "solver/prediction.hpp"

namespace vbaa::solver {

namespace {

constexpr int EVERY = 4, FOOT_STEPS = 2;  // a foot is searched from the nearest of every fourth node by Newton steps
constexpr double CONVERGED = 1e-4;        // part of the cost that the last step of a linear problem promises at most

// The numbers at eight places.
Lanes gather(const double* from, const int* at) {
    Lanes values = {};
    for (int lane = 0; lane < LANES; ++lane) values[lane] = from[at[lane]];
    return values;
}

// Half the squares of whitened residuals of these sizes, linear beyond HUBER; what is not a number stays so.
Lanes huber_losses(Lanes size) {
    const Lanes inner = where_positive(size - HUBER, HUBER, size);
    return inner * (size - 0.5 * inner);
}

double huber_loss(double residual) {
    const double size = std::abs(residual), inner = size > HUBER ? HUBER : size;
    return inner * (size - 0.5 * inner);
}

// Subtracts a displacement (M,) of the curve from the points' distances.
void take_out(Fit& fit, ConstVector shift) {
    double* distance = fit.distance.begin();
    for (int i = 0; i < fit.points; i += LANES) {
        const int* node = fit.node.begin() + i;
        const Lanes before = gather(shift.data, node), after = gather(shift.data + 1, node);
        store(distance + i, load(distance + i) - before - load(fit.share.begin() + i) * (after - before));
    }
}

// Sums of weights w and residuals r of neighbouring points between the same two nodes, at shares s of the way.
struct Sums {
    double w = 0.0, ws = 0.0, wss = 0.0, wr = 0.0, wrs = 0.0;

    void put(Fit& fit, int node) const {
        fit.diagonal[node] += w - 2.0 * ws + wss;
        fit.diagonal[node + 1] += wss;
        fit.off_diagonal[node] += ws - wss;
        fit.pull[node] += wr - wrs;
        fit.pull[node + 1] += wrs;
    }
};

// Adds one picture's points to COUNT vectors of the right side, from a column on.
template <int COUNT>
void pull_along(Fit& fit, int clamp, int first) {
    Lanes totals[COUNT];
    for (int c = 0; c < COUNT; ++c) totals[c] = load(&fit.side[first + c * LANES]);
    for (int j = clamp; j < clamp + NODES; ++j) {
        for (int c = 0; c < COUNT; ++c) totals[c] += fit.pull[j] * load(&fit.columns(j, first + c * LANES));
    }
    for (int c = 0; c < COUNT; ++c) store(&fit.side[first + c * LANES], totals[c]);
}

// The information of the nodes from `clamp` on times one vector of columns at them. Between two pictures it is 0.
void times_tridiagonal(const Fit& fit, int clamp, int first, ConstMatrix columns, Matrix product) {
    const double *diagonal = &fit.diagonal[clamp], *off_diagonal = &fit.off_diagonal[clamp];
    const int last = columns.shape[0] - 1;
    Lanes before = spread(0.0), here = load(&columns(0, first));
    double by_before = 0.0;
    for (int j = 0; j < last; ++j) {
        const Lanes after = load(&columns(j + 1, first));
        store(&product(j, first), by_before * before + diagonal[j] * here + off_diagonal[j] * after);
        before = here, here = after, by_before = off_diagonal[j];
    }
    store(&product(last, first), by_before * before + diagonal[last] * here);
}

double state_of(const Fit& fit, int column) {
    return column < UNKNOWNS ? fit.unknowns[column] : fit.steps[column - UNKNOWNS];
}

}  // namespace

double prior_of(const Rig& rig, const Fit& fit, int column) {
    if (column == 0) return 0.0;
    if (column >= UNKNOWNS - 1) return 1.0;
    const double bent = tip_deflection(rig, fit.contact_m / rig.length_m) / TIP_DEFLECTION_STD;
    return bent * bent;
}

void nearest_feet(const Rig& rig, const Frame& frame, Fit& fit) {
    const double *u = frame.u(), *v = frame.v();
    double at_node[NODES];
    for (int j = 0; j < NODES; j += EVERY) at_node[j] = arclength_of_node(fit, rig.length_m, j);
    for (int i = 0; i < fit.points; i += LANES) {
        Lanes best = spread(std::numeric_limits<double>::infinity()), foot_m = spread(at_node[0]);
        const int* clamp = frame.clamp.begin() + i;
        const bool one = clamp[0] == clamp[LANES - 1];  // picture for all
        for (int j = 0; j < NODES; j += EVERY) {
            const Lanes there_u = one ? spread(fit.u[clamp[0] + j]) : gather(fit.u.begin() + j, clamp);
            const Lanes there_v = one ? spread(fit.v[clamp[0] + j]) : gather(fit.v.begin() + j, clamp);
            const Lanes off_u = load(u + i) - there_u, off_v = load(v + i) - there_v;
            const Lanes square = off_u * off_u + off_v * off_v, nearer = best - square;
            best = where_positive(nearer, square, best);
            foot_m = where_positive(nearer, at_node[j], foot_m);
        }
        store(fit.foot_m.begin() + i, foot_m);
    }
    for (int step = 0; step < FOOT_STEPS; ++step) point_residuals(rig, frame, fit);
}

void feet_along_chord(const Rig& rig, const Frame& frame, Fit& fit) {
    const double *u = frame.u(), *v = frame.v();
    for (int i = 0, end = 0; i < fit.foot_m.size(); i = end) {
        const int clamp = frame.clamp[i], tip = clamp + LAST;
        const double start_u = fit.u[clamp], start_v = fit.v[clamp];
        const double chord_u = fit.u[tip] - start_u, chord_v = fit.v[tip] - start_v;
        const double by_square = 1.0 / (chord_u * chord_u + chord_v * chord_v);
        const double near = fit.depth[clamp], far = fit.depth[tip];
        while (end < fit.foot_m.size() && frame.clamp[end] == clamp) ++end;
        for (int k = i; k < end; ++k) {
            const double along = ((u[k] - start_u) * chord_u + (v[k] - start_v) * chord_v) * by_square;
            const double seen = std::min(std::max(along, 0.0), 1.0);
            fit.foot_m[k] = seen * near / (far - (far - near) * seen) * rig.length_m;
        }
    }
}

// Residuals of the points, with the curve's parabola at the previous feet: an error e of a foot becomes one of order
// e³ in the residual.
void point_residuals(const Rig& rig, const Frame& frame, Fit& fit) {
    const double length = rig.length_m, contact = fit.contact_m;
    const double inner = contact / CONTACT, outer = (length - contact) / NODES_BEYOND;
    const double by_inner = 1.0 / inner, by_outer = 1.0 / outer;
    const double *u = frame.u(), *v = frame.v(), *xx = frame.xx(), *xy = frame.xy(), *yy = frame.yy();
    double *feet = fit.foot_m.begin(), *shares = fit.share.begin();
    double *distances = fit.distance.begin(), *precisions = fit.precision.begin();
    const double* cubics = fit.cubics.begin();
    int* nodes = fit.node.begin();
    for (int i = 0; i < fit.points; i += LANES) {
        const Lanes foot = load(feet + i), beyond = where_positive(foot - contact, foot - contact, 0.0);
        const Lanes along = (foot - beyond) * by_inner + beyond * by_outer;
        const Lanes within = where_positive(along, along, 0.0);
        constexpr double end = LAST - 1e-6;
        const Lanes before = truncated(where_positive(within - end, end, within), nodes + i), share = along - before;
        store(shares + i, share);
        Lanes cubic[8];
        for (int lane = 0; lane < LANES; ++lane) {
            nodes[i + lane] += frame.clamp[i + lane];
            cubic[lane] = load(cubics + 8 * nodes[i + lane]);
        }
        transpose(cubic);
        const Lanes rise_u = cubic[3] * share, rise_v = cubic[7] * share, bend_u = cubic[2], bend_v = cubic[6];
        const Lanes off_u = load(u + i) - (((rise_u + bend_u) * share + cubic[1]) * share + cubic[0]);
        const Lanes off_v = load(v + i) - (((rise_v + bend_v) * share + cubic[5]) * share + cubic[4]);
        const Lanes u1 = (3.0 * rise_u + 2.0 * bend_u) * share + cubic[1], u2 = 6.0 * rise_u + 2.0 * bend_u;
        const Lanes v1 = (3.0 * rise_v + 2.0 * bend_v) * share + cubic[5], v2 = 6.0 * rise_v + 2.0 * bend_v;
        const Lanes square = u1 * u1 + v1 * v1, by_square = 1.0 / square;
        const Lanes ahead = (off_u * u1 + off_v * v1) * by_square;
        const Lanes bounded = where_positive(ahead - 1.0, 1.0, where_positive(-1.0 - ahead, -1.0, ahead));
        // the normal is (−v′, u′)/√(u′² + v′²)
        const Lanes across = off_v * u1 - off_u * v1 - 0.5 * (v2 * u1 - u2 * v1) * bounded * bounded;
        store(distances + i, across * sqrt(by_square));
        store(precisions + i,
              square / (load(xx + i) * v1 * v1 - 2.0 * load(xy + i) * u1 * v1 + load(yy + i) * u1 * u1));
        const Lanes there = foot + ahead * where_positive(CONTACT - 0.5 - before, inner, outer);
        // a prediction that left the domain of the model is rejected by its cost, not here
        const Lanes positive = where_positive(there, there, 0.0);
        store(feet + i, where_positive(positive - length, length, positive));
    }
    for (int i = fit.points; i < fit.distance.size(); ++i) distances[i] = precisions[i] = 0.0;
}

void shift_by_steps(const Fit& fit, int first, const double* steps, int count, Vector shift) {
    for (int j = 0; j < fit.nodes; ++j) {
        const double* row = &fit.columns(j, first);
        double total = 0.0;
        for (int k = 0; k < count; ++k) total += row[k] * steps[k];
        shift[j] = total;
    }
}

void residuals_with_rig(Fit& fit, Vector shift) {
    std::copy_n(fit.predicted_residual, READINGS, fit.residual);
    const int count = fit.steps.size();
    if (count == 0) return;
    shift_by_steps(fit, UNKNOWNS, fit.steps.begin(), count, shift);
    take_out(fit, shift);
    for (int reading = 0; reading < fit.readings; ++reading) {
        for (int k = 0; k < count; ++k) {
            fit.residual[reading] -= fit.reading_columns(reading, UNKNOWNS + k) * fit.steps[k];
        }
    }
}

void step_linearly(Fit& fit, const double* step, Vector shift) {
    shift_by_steps(fit, 0, step, fit.size, shift);
    take_out(fit, shift);
    for (int k = 0; k < fit.size; ++k) {
        for (int reading = 0; reading < fit.readings; ++reading) {
            const double change = fit.reading_columns(reading, k) * step[k];
            fit.residual[reading] -= change;
            if (k < UNKNOWNS) fit.predicted_residual[reading] -= change;
        }
        if (k >= UNKNOWNS) continue;
        for (int q = 0; q < 6; ++q) fit.point_force[q] += fit.point_force_columns(q, k) * step[k];
    }
}

double points_cost(Fit& fit) {
    for (Array<double, 1>* each : {&fit.diagonal, &fit.off_diagonal, &fit.pull}) fill(each->view(), 0.0);
    const double by_scatter = 1.0 / fit.scatter, square = by_scatter * by_scatter;
    Lanes costs = spread(0.0);
    Sums sums;  // written when the next node begins
    int before = 0;
    for (int i = 0; i < fit.points; i += LANES) {
        const Lanes precision = load(fit.precision.begin() + i), distance = load(fit.distance.begin() + i);
        const Lanes size = absolute(distance) * sqrt(precision) * by_scatter;
        costs += huber_losses(size);
        // NaN has full weight here: its cost shows it
        const Lanes w = HUBER / where_positive(size - HUBER, size, HUBER) * precision * square;
        const Lanes share = load(fit.share.begin() + i), ws = w * share, wr = w * distance;
        double table[5][LANES];
        store(table[0], w), store(table[1], ws), store(table[2], ws * share), store(table[3], wr);
        store(table[4], wr * share);
        const int some = std::min(LANES, fit.points - i), *nodes = fit.node.begin() + i;
        for (int lane = 0; lane < some; ++lane) {
            if (nodes[lane] != before) {
                sums.put(fit, before);
                sums = Sums{};
                before = nodes[lane];
            }
            sums.w += table[0][lane];
            sums.ws += table[1][lane];
            sums.wss += table[2][lane];
            sums.wr += table[3][lane];
            sums.wrs += table[4][lane];
        }
    }
    sums.put(fit, before);
    return sum(costs);
}

void times_tridiagonal(const Fit& fit, ConstMatrix columns, Matrix product) {
    for (int first = 0; first < columns.shape[1]; first += LANES) times_tridiagonal(fit, 0, first, columns, product);
}

void information_of_points(const Rig& rig, Fit& fit, Matrix product) {
    fill(fit.information.view(), 0.0);
    int clamp = 0;
    for (const Camera& camera : rig.cameras) {
        const ConstMatrix columns = ConstMatrix(fit.columns).part(clamp, NODES);
        const Matrix own = product.part(clamp, NODES);
        for (int each : camera.vectors) times_tridiagonal(fit, clamp, each * LANES, columns, own);
        add_inner_products(columns, own, camera.vectors, fit.information);
        clamp += NODES;
    }
}

void normal_equations(const Rig& rig, Fit& fit, int first, Matrix product) {
    double cost = points_cost(fit), weight[READINGS] = {};
    information_of_points(rig, fit, product);
    const int size = fit.size, wide = fit.side.size();
    fill(fit.side.view(), 0.0);
    for (std::size_t k = 0; k < rig.cameras.size(); ++k) {
        const int clamp = static_cast<int>(k) * NODES;
        by_vectors(rig.cameras[k].vectors, [&](auto count, int column) { pull_along<count>(fit, clamp, column); });
    }
    for (int reading = 0; reading < fit.readings; ++reading) {
        weight[reading] = huber_weight(fit.residual[reading]);
        cost += huber_loss(fit.residual[reading]);
    }
    const double *by_y = &fit.reading_columns(0, 0), *by_z = &fit.reading_columns(1, 0),
                 *by_end = &fit.reading_columns(2, 0);
    for (int a = first; a < size; ++a) {
        const double y = weight[0] * by_y[a], z = weight[1] * by_z[a], end = weight[2] * by_end[a];
        fit.side[a] += y * fit.residual[0] + z * fit.residual[1] + end * fit.residual[2];
        double* row = &fit.information(a, 0);
        for (int b = a / LANES * LANES; b < wide; b += LANES) {
            store(row + b, load(row + b) + y * load(by_y + b) + z * load(by_z + b) + end * load(by_end + b));
        }
    }
    for (int reading = USUAL_READINGS; reading < fit.readings; ++reading) {
        const double* by = &fit.reading_columns(reading, 0);
        for (int a = first; a < size; ++a) {
            const double weighted = weight[reading] * by[a];
            fit.side[a] += weighted * fit.residual[reading];
            double* row = &fit.information(a, 0);
            for (int b = a / LANES * LANES; b < wide; b += LANES)
                store(row + b, load(row + b) + weighted * load(by + b));
        }
    }
    for (int a = first; a < size; ++a) {
        const double prior = prior_of(rig, fit, a), at = state_of(fit, a);
        fit.information(a, a) += prior;
        fit.side[a] -= prior * at;
        cost += 0.5 * prior * at * at;
        for (int b = first; b < a; ++b) fit.information(a, b) = fit.information(b, a);
    }
    fit.cost = cost;
}

void linearise(const Rig& rig, const Frame& frame, Fit& fit, Work& work) {
    point_residuals(rig, frame, fit);
    residuals_with_rig(fit, work.shift);
}

void evaluate(const Rig& rig, const Frame& frame, int rung, Fit& fit, Work& work) {
    ++work.evaluations;
    predict(rig, frame, rung, work.bent, fit, true);
    linearise(rig, frame, fit, work);
    normal_equations(rig, fit, 0, work.product);
}

double total_cost(const Rig& rig, const Fit& fit) {
    Lanes costs = spread(0.0);
    for (int i = 0; i < fit.points; i += LANES) {
        const Lanes distance = load(fit.distance.begin() + i), precision = load(fit.precision.begin() + i);
        costs += huber_losses(absolute(distance) * sqrt(precision) * (1.0 / fit.scatter));
    }
    double cost = sum(costs);
    for (int reading = 0; reading < fit.readings; ++reading) cost += huber_loss(fit.residual[reading]);
    for (int a = 1; a < fit.size; ++a) {
        const double at = state_of(fit, a);
        cost += 0.5 * prior_of(rig, fit, a) * at * at;
    }
    return cost;
}

double least_cost(const Rig& rig, Fit& fit, int first, int rounds, Work& work, double enough) {
    const int size = fit.size - first;
    double* step = work.step.begin();
    for (int round = 0; round < rounds; ++round) {
        normal_equations(rig, fit, first, work.product);
        factorise(fit.information, first, size, 0.0, work.factor, work.scale);
        solve_factorised(work.factor, work.scale, size, &fit.side[first], step);
        double promise = 0.0;
        for (int k = 0; k < size; ++k) promise += fit.side[first + k] * step[k];
        shift_by_steps(fit, first, step, size, work.shift);
        take_out(fit, work.shift);
        for (int k = 0; k < size; ++k) {
            const int a = first + k;
            for (int reading = 0; reading < fit.readings; ++reading) {
                fit.residual[reading] -= fit.reading_columns(reading, a) * step[k];
            }
            (a < UNKNOWNS ? fit.unknowns[a] : fit.steps[a - UNKNOWNS]) += step[k];
        }
        // the next step would promise about a fifth of this one
        if (promise < std::max(CONVERGED * (1.0 + fit.cost), fit.cost - promise - enough)) break;
    }
    return total_cost(rig, fit);
}

void put_rough_steps(const Rig& rig, const Fit& rough, double* steps) {
    const int lines = rig.lines(), axes = rough.steps.size() - lines;
    std::copy_n(rough.steps.begin(), axes, steps);
    std::copy_n(rough.steps.begin() + axes, lines, steps + rig.shared);
}

double unscaled_cost(const Rig& rig, Fit& fit) {
    if (fit.scatter == 1.0) return fit.cost;
    const double scatter = fit.scatter;
    fit.scatter = 1.0;
    const double cost = total_cost(rig, fit);
    fit.scatter = scatter;
    return cost;
}

}  // namespace vbaa::solver
