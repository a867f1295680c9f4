#include "solver/linearised.hpp"

#include <algorithm>
#include <cmath>

#include "solver/initialization.hpp"
#include "solver/normal_equations.hpp"
#include "solver/prediction.hpp"
#include "solver/rig_jacobian.hpp"
#include "solver/uncertainty.hpp"

namespace vbaa::solver {
namespace {

// A part of a wider matrix, its rows from `row` and its columns from `column` on.
void copy_part(ConstMatrix source, int row, int column, Matrix target) {
    for (int a = 0; a < target.shape[0]; ++a) {
        std::copy_n(source.row(row + a).data + column, target.shape[1], target.row(a).data);
    }
}

}  // namespace

void linearise_frames(const Rig& rig, const Frames& frames, int rung, ConstMatrix unknowns, const Linearised& found) {
    for (int index = 0; index < frames.size(); ++index) {
        const Frame frame = frame_of(rig, frames, index);
        Work work(rig, frame.count);
        Fit& fit = work.best;
        std::copy_n(unknowns.row(index).data, UNKNOWNS, fit.unknowns.begin());
        predict(rig, frame, rung, work.bent, fit, true);
        rig_jacobian(rig, frame, rung, work.bent, fit);
        nearest_feet(rig, frame, fit);
        linearise(rig, frame, fit, work);
        normal_equations(rig, fit, 0, work.product);
        copy_part(view(fit.tangents), 0, 0, found.tangents.row(index));
        std::copy_n(fit.point_force, 6, found.point_force.row(index).data);
        std::copy_n(fit.residual, fit.readings, found.residual.row(index).data);
        std::copy_n(fit.side.begin(), fit.size, found.side.row(index).data);
        copy_part(fit.point_force_columns, 0, 0, found.columns.row(index));
        copy_part(fit.reading_columns, 0, 0, found.readings.row(index));
        copy_part(fit.information, 0, 0, found.information.row(index));
        for (int a = 0; a < fit.size; ++a) found.prior(index, a) = prior_of(rig, fit, a);
        found.excess[index] = huber_excess(fit);
    }
}

void free_frames(const Rig& rig, const Frames& frames, ConstMatrix steps, double farthest_std,
                 const FreeAntennas& found) {
    for (int index = 0; index < frames.size(); ++index) {
        const Frame frame = frame_of(rig, frames, index);
        Work work(rig, frame.count);
        Fit& fit = work.best;
        free_antenna(rig, frame, fit, work);
        found.gain[index] = largest_gain(grid_search(rig, frame, fit, 1.0, work));
        double variance = 1.0;
        double* end = fit.reading_columns.row(END).data;
        for (int k = UNKNOWNS; k < fit.size; ++k) variance += end[k] * end[k];
        if (!(std::abs(fit.residual[END]) <= farthest_std * std::sqrt(variance))) {
            fit.predicted_residual[END] = 0.0;
            std::fill_n(end, fit.reading_columns.shape[1], 0.0);
        }
        std::copy_n(steps.row(index).data, rig.steps(), fit.steps.begin());
        residuals_with_rig(fit, work.shift);
        normal_equations(rig, fit, UNKNOWNS, work.product);
        copy_part(fit.information, UNKNOWNS, UNKNOWNS, found.information.row(index));
        std::copy_n(fit.side.begin() + UNKNOWNS, rig.steps(), found.side.row(index).data);
    }
}

}  // namespace vbaa::solver
