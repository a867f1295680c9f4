#include "detect/clearest_curve.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "smooth.hpp"

namespace vbaa::detect {
namespace {

// What a bent curve must show more.
constexpr double BENT_COST = 0.3;
// After so many points each, a curve is given up that the rest cannot make the clearest.
constexpr int GIVEN_UP = 12;
// Another curve is followed, too, if it is this part as clear and far off the clearest in so many of the points after
// the first ones.
constexpr double BRANCH_SHARE = 0.7;
constexpr int BRANCH_AFTER = 20, BRANCH_POINTS = 8;

struct Clearest {
    int curve = -1;
    double clear = -std::numeric_limits<double>::infinity();
};

// Whether a curve is elsewhere than another.
bool leaves(const Curves& tried, int curve, int other, double apart_px) {
    int far = 0;
    for (int i = BRANCH_AFTER; i < CURVE_POINTS; ++i)
        far += std::abs(tried.rows(curve, i) - tried.rows(other, i)) > apart_px;
    return far >= BRANCH_POINTS;
}

// The clearest curve of a strip (CURVE_POINTS, R) that is clearer than `found` and leaves its curve, if it is of one.
// rest : (CURVE_POINTS + 1,) what the strip's points from each one on can add.
Clearest clearest(ConstMatrix strip, const Curves& tried, double cost, ConstVector rest, Clearest known,
                  double apart_px) {
    Clearest found{-1, known.clear};
    for (int c = 0; c < tried.rows.shape[0]; ++c) {
        if (known.curve >= 0 && !leaves(tried, c, known.curve, apart_px)) continue;
        double total = -cost * tried.bent[c];
        for (int start = 0; start < CURVE_POINTS; start += GIVEN_UP) {
            if (total + rest[start] * (1.0 + 1e-9) < found.clear) break;
            for (int i = start; i < start + GIVEN_UP; ++i) total += strip(i, tried.rows(c, i));
        }
        if (total > found.clear) found = {c, total};
    }
    return found;
}

// (CURVE_POINTS,) the clearest curve of a strip (CURVE_POINTS, R) near one of those that were tried.
Array<double, 1> finer(ConstMatrix strip, const Curves& tried, int curve) {
    int finest = 0;
    double most = -std::numeric_limits<double>::infinity();
    for (int f = 0; f < tried.finer.shape[0]; ++f) {
        double total = 0.0;
        for (int i = 0; i < CURVE_POINTS; ++i) {
            const int row = static_cast<int>(std::rint(tried.curves(curve, i) + tried.finer(f, i))) + tried.reach;
            total += strip(i, std::clamp(row, 0, 2 * tried.reach));
        }
        if (total > most) finest = f, most = total;
    }
    Array<double, 1> best(tried.curves.row(curve));
    for (int i = 0; i < CURVE_POINTS; ++i) best[i] += tried.finer(finest, i);
    return best;
}

}  // namespace

Curves::Curves(int reach_px, ConstMatrix curves_px, ConstVector how_bent, ConstMatrix finer_px)
    : reach(reach_px), curves(curves_px), rows(curves_px.shape[0], CURVE_POINTS), bent(how_bent), finer(finer_px) {
    const double last = 2.0 * reach;
    for (int at = 0; at < rows.size(); ++at)
        rows[at] = static_cast<std::int16_t>(std::min(std::max(0.0, std::rint(curves[at] + reach)), last));
}

ClearestCurves clearest_curves(ConstMatrix clarity, const Curves& tried, double apart_px) {
    const int count = clarity.shape[0];
    Array<double, 1> columns(CURVE_POINTS), rest(CURVE_POINTS + 1);
    Array<double, 2> few(CURVE_POINTS, clarity.shape[1]);
    for (int i = 0; i < CURVE_POINTS; ++i) {
        columns[i] = i * ((count - 1.0) / (CURVE_POINTS - 1));
        copy(clarity.row(static_cast<int>(std::rint(columns[i]))), few.row(i));
    }
    const Array<double, 2> thick = highest_nearby(few, static_cast<int>(CURVE_STEP_PX) + 1);
    for (int i = CURVE_POINTS - 1; i >= 0; --i) {
        const ConstVector row = thick.row(i);
        rest[i] = rest[i + 1] + *std::max_element(row.begin(), row.end());
    }
    const double cost = BENT_COST * *std::max_element(thick.begin(), thick.end()) * CURVE_POINTS;
    const Clearest best = clearest(thick, tried, cost, rest, {}, 0.0);
    const Clearest other = clearest(thick, tried, cost, rest, {best.curve, BRANCH_SHARE * best.clear}, apart_px);
    const auto along = [&](int curve) {
        if (curve < 0) return Array<double, 1>(0);
        const Array<double, 1> found = finer(few, tried, curve);
        Array<double, 1> each(count);
        for (int k = 0; k < count; ++k) each[k] = interpolated(columns, found, k);
        return each;
    };
    return {along(std::max(best.curve, 0)), along(best.curve < 0 ? -1 : other.curve)};
}

Array<double, 2> highest_nearby(ConstMatrix values, int rows) {
    const int columns = values.shape[0], last = values.shape[1] - 1, half = rows / 2;
    Array<double, 2> highest(values);
    for (int k = 0; k < columns; ++k)
        for (int off = 1; off <= half; ++off) {
            for (int r = off; r <= last; ++r) highest(k, r) = std::max(highest(k, r), values(k, r - off));
            for (int r = 0; r <= last - off; ++r) highest(k, r) = std::max(highest(k, r), values(k, r + off));
        }
    return highest;
}

}  // namespace vbaa::detect
