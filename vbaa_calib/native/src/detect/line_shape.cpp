// The antenna's cross-section: tables, learning, and the linear fit of every profile.
#include "detect/line_shape.hpp"

#include <array>

namespace vbaa::detect {

namespace {

constexpr int BINS_PER_PX = 4;
constexpr std::array<double, 3> WIDTHS = {0.85, 1.0, 1.2};  // tried, as parts of the antenna's width
constexpr std::array<double, 9> BLURS_PX = {0.45, 0.6, 0.8, 1.0, 1.3, 1.7, 2.2, 3.0, 4.0};  // tried
constexpr double KNOT_PX = 0.85;       // spacing of the splines' knots: finer than the point spread of an ordinary lens
constexpr double BEND_PENALTY = 1e-3;  // of a learned shape's coefficients, over the mean weight of a bin
constexpr double MIN_FREED = 0.15;

// Profile n's cross-section and its derivative at distances (T,) from the centre, px: into (T,) each.
void look_up(const CrossSection& section, int n, ConstVector across, Vector value, Vector slope) {
    const int last = section.values.shape[0] - 1, several = section.values.shape[1];
    const double* const values = section.values.begin();
    const double* const slopes = section.slopes.begin();
    const double* const weights = section.weights.size() ? section.weights.row(n).data : nullptr;
    for (int t = 0; t < across.shape[0]; ++t) {
        const double place = bounded(across[t] * PER_PX + 0.5 * last, 0.0, last);
        const int row = std::min(static_cast<int>(place), last - 1);
        const double far = place - row, near = 1.0 - far;
        if (!weights) {
            value[t] = near * values[row] + far * values[row + 1];
            slope[t] = near * slopes[row] + far * slopes[row + 1];
            continue;
        }
        double v = 0.0, s = 0.0;
        for (int c = 0, at = row * several; c < several; ++c, ++at) {
            v += weights[c] * (near * values[at] + far * values[at + several]);
            s += weights[c] * (near * slopes[at] + far * slopes[at + several]);
        }
        value[t] = v;
        slope[t] = s;
    }
}

// The cubic spline of one knot among equal ones, by the distance from it in knots.
double spline(double off) {
    const double away = std::min(std::abs(off), 2.0);
    return away < 1.0 ? (4.0 - 3.0 * away * away * (2.0 - away)) / 6.0 : square(2.0 - away) * (2.0 - away) / 6.0;
}

double spline_slope(double off) {
    const double away = std::min(std::abs(off), 2.0);
    const double slope = away < 1.0 ? 1.5 * away * away - 2.0 * away : -0.5 * square(2.0 - away);
    return off < 0.0 ? -slope : slope;
}

// (rows, inner + 2) splines about knots on both sides, the farthest first, in rows `per_px` apart from −reach_px on.
template <class Spline>
Table even_splines(Spline function, int inner, int reach_px, int per_px, double first, int rows) {
    Table table(rows, inner + 2);
    for (int r = 0; r < rows; ++r)
        for (int m = 0; m < inner + 2; ++m) {
            const double off = ((r + first) / per_px - reach_px) * inner / reach_px, knot = inner + 1 - m;
            table(r, m) = function(off + knot) + (m <= inner ? function(off - knot) : 0.0);
        }
    return table;
}

// (R, 1) of a table (R, M) and coefficients (M,).
Table product(const Table& table, ConstVector coefficients) {
    Table values(table.shape[0], 1);
    for (int r = 0; r < table.shape[0]; ++r) values.values[r] = dot(table.row(r), coefficients);
    return values;
}

}  // namespace

Table slopes_of(const Table& values) {
    Table slopes(values.shape[0], values.shape[1]);
    const int last = values.shape[0] - 1;
    for (int r = 0; r <= last; ++r) {
        const int before = std::max(r - 1, 0), after = std::min(r + 1, last);
        for (int c = 0; c < values.shape[1]; ++c)
            slopes(r, c) = (values(after, c) - values(before, c)) * (static_cast<double>(PER_PX) / (after - before));
    }
    return slopes;
}

CrossSection expected(double width_px, double blur_px, int reach_px) {
    const int middle = reach_px * PER_PX, last = 2 * middle;
    const double half = 0.5 * width_px, blur = PER_PX * std::hypot(blur_px, PIXEL_BLUR_PX);
    Numbers spread = each(last + 1, [&](int r) { return std::exp(-0.5 * square((r - middle) / blur)); });
    const double whole = total(spread);
    Table line(last + 1, 1);
    double* const values = line.begin();
    for (int b = 0; b <= last; ++b) {
        const double across = std::abs(b - middle) / static_cast<double>(PER_PX);
        if (!(across < half)) continue;
        const double body = (0.4 + 0.6 * std::sqrt(std::max(1.0 - square(across / half), 0.0))) / whole;
        const double* const shifted = spread.begin() + middle - b;
        for (int r = std::max(b - middle, 0); r <= std::min(last, b + middle); ++r) values[r] += body * shifted[r];
    }
    const double top = *std::max_element(line.begin(), line.end());
    for (double& value : line) value /= top;
    Table slopes = slopes_of(line);
    return {std::move(line), std::move(slopes), {}};
}

double half_width_px(const CrossSection& section) {
    const auto above = [](double value) { return value > 0.5; };
    return static_cast<double>(std::count_if(section.values.begin(), section.values.end(), above)) / (2.0 * PER_PX);
}

Shapes shapes(double width_px, double blur_px, int reach_px) {
    const int inner = std::max(4, static_cast<int>(std::ceil(reach_px / KNOT_PX)));
    const int bins = 2 * reach_px * BINS_PER_PX, rows = 2 * reach_px * PER_PX + 1;
    Shapes made;
    made.reach_px = reach_px;
    made.bins = even_splines(spline, inner, reach_px, BINS_PER_PX, 0.5, bins);
    made.values = even_splines(spline, inner, reach_px, PER_PX, 0.0, rows);
    made.slopes = even_splines(spline_slope, inner, reach_px, PER_PX, 0.0, rows);
    for (double& slope : made.slopes) slope *= static_cast<double>(inner) / reach_px;
    made.ordinary = expected(width_px, blur_px, reach_px);
    made.blurred_bins = Table(WIDTHS.size() * BLURS_PX.size(), bins);
    for (double part : WIDTHS)
        for (double blur : BLURS_PX) {
            const int f = static_cast<int>(made.blurred.size());
            made.blurred.push_back(expected(width_px * part, blur, reach_px));
            for (int b = 0; b < bins; ++b)
                made.blurred_bins(f, b) = made.blurred[f].values.values[(2 * b + 1) * PER_PX / (2 * BINS_PER_PX)];
        }
    return made;
}

Binned binned(const Crossings& found, ConstVector centre, const Table& heights, const Flags& chosen, int reach_px) {
    const int bins = 2 * reach_px * BINS_PER_PX, length = heights.shape[1];
    Binned seen = {Numbers(bins), Numbers(bins)};
    Numbers across(length);
    for (int n : places(chosen)) {
        distances(found, n, centre[n], across);
        for (int t = 0; t < length; ++t) {
            const int at = static_cast<int>(bounded((across[t] + reach_px) * BINS_PER_PX, 0.0, bins));
            if (at == bins) continue;
            seen.number[at] += 1.0;
            seen.mean[at] += heights(n, t);
        }
    }
    for (int b = 0; b < bins; ++b) seen.mean[b] /= std::max(seen.number[b], 1.0);
    return seen;
}

double lopsided(const Binned& seen, double noise) {
    const int last = seen.mean.size() - 1;
    double whole = 0.0, power = 0.0;
    int used = 0;
    for (int b = 0; b <= last; ++b) {
        const double one = seen.mean[b], other = seen.mean[last - b];
        const double weight = std::min(seen.number[b], seen.number[last - b]);
        if (!(weight > 0.0 && std::abs(one) + std::abs(other) > 0.2)) continue;
        whole += weight;
        power += weight * square(0.5 * (one - other));
        ++used;
    }
    whole = std::max(whole, 1.0);
    return std::sqrt(std::max(power / whole - noise * noise * used / whole, 0.0));
}

CrossSection nearest(const Binned& seen, const Shapes& known) {
    const int bins = seen.number.size();
    const double whole = total(seen.number), offset = dot(seen.mean, seen.number) / whole;
    int best = 0;
    double most = -INFINITY;
    for (int f = 0; f < known.blurred_bins.shape[0]; ++f) {
        const ConstVector shape = known.blurred_bins.row(f);
        const double middle = dot(shape, seen.number) / whole;
        double product = 0.0, power = 0.0;
        for (int b = 0; b < bins; ++b) {
            const double weighted = (shape[b] - middle) * seen.number[b];
            product += weighted * (seen.mean[b] - offset);
            power += weighted * (shape[b] - middle);
        }
        // the height that fits each shape best is left free
        const double match = product * product / std::max(power, 1e-9);
        if (match > most) best = f, most = match;
    }
    return known.blurred[best];
}

CrossSection learn(const Binned& seen, const Shapes& known) {
    const int count = known.bins.shape[0], several = known.bins.shape[1];
    Table matrix(several, several), side(several, 1);
    for (int b = 0; b < count; ++b) {
        const ConstVector bin = known.bins.row(b);
        for (int i = 0; i < several; ++i) {
            const double weight = seen.number[b] * bin[i];
            if (weight == 0.0) continue;
            side(i, 0) += weight * seen.mean[b];
            for (int j = 0; j <= i; ++j) matrix(i, j) += weight * bin[j];
        }
    }
    constexpr std::array<double, 3> second = {1.0, -2.0, 1.0};
    const double whole = total(seen.number), bend = BEND_PENALTY * whole / count;
    for (int k = 0; k < several - 2; ++k)
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j <= i; ++j) matrix(k + i, k + j) += bend * second[i] * second[j];
    for (int i = 0; i < several; ++i) matrix(i, i) += 1e-9 * (1.0 + whole);
    solve_definite(matrix, side);
    const ConstVector coefficients(side.begin(), {several});
    Table shape = product(known.values, coefficients), slope = product(known.slopes, coefficients);
    const double ground = 0.5 * (shape.values.front() + shape.values.back());
    for (double& value : shape) value -= ground;
    const double top = *std::max_element(shape.begin(), shape.end()), scale = top > 1e-6 ? top : 1.0;
    for (double& value : shape) value /= scale;
    for (double& value : slope) value /= scale;
    return {std::move(shape), std::move(slope), {}};
}

Fits fit(const CrossSection& section, const Crossings& found, ConstVector centre) {
    const int count = found.profiles.shape[0], length = found.profiles.shape[1];
    const double middle = 0.5 * (length - 1), per_spread = 12.0 / (length * (square(length) - 1.0));
    Fits fits;
    for (Numbers* each : {&fits.shift, &fits.height, &fits.unit_height, &fits.rms, &fits.stepped, &fits.stepped_unit})
        *each = Numbers(count);
    for (Table* each : {&fits.gain, &fits.residuals, &fits.freed}) *each = Table(count, length);
    // shape, change with its place, grey levels and a step: their background is removed
    Numbers across(length);
    Table rows(4, length);
    double *const v = rows.row(0).data, *const s = rows.row(1).data, *const y = rows.row(2).data,
                  *const b = rows.row(3).data;
    for (int n = 0; n < count; ++n) {
        distances(found, n, centre[n], across);
        look_up(section, n, across, rows.row(0), rows.row(1));
        const double by_centre = -found.side[n] / found.stretch[n];
        const double* const levels = found.profiles.row(n).data;
        for (int t = 0; t < length; ++t) {
            s[t] *= by_centre;
            y[t] = levels[t];
            b[t] = bounded(across[t], -1.0, 1.0);
        }
        remove_background(rows);
        double vv = 0.0, vs = 0.0, ss = 0.0, vy = 0.0, sy = 0.0, vb = 0.0, sb = 0.0;
        for (int t = 0; t < length; ++t) {
            vv += v[t] * v[t], vs += v[t] * s[t], ss += s[t] * s[t];
            vy += v[t] * y[t], sy += s[t] * y[t], vb += v[t] * b[t], sb += s[t] * b[t];
        }
        const double determinant = std::max(vv * ss - vs * vs, 1e-9);
        const double height = (ss * vy - vs * sy) / determinant, product = (vv * sy - vs * vy) / determinant;
        const double per_height = 1.0 / (std::abs(height) > 1e-6 ? height : 1e-6);
        // the step, less what height and place make of it
        const double moved = (vv * sb - vs * vb) / determinant, left = (ss * vb - vs * sb) / determinant;
        const double by_slope = vv / determinant, by_value = vs / determinant, per_power = 1.0 / std::max(vv, 1e-9);
        double *const gain = fits.gain.row(n).data, *const residuals = fits.residuals.row(n).data,
                      *const freed = fits.freed.row(n).data;
        double squares = 0.0, power = 0.0, stepped = 0.0;
        for (int t = 0; t < length; ++t) {
            const double x = t - middle, by_pixel = by_slope * s[t] - by_value * v[t];
            const double residual = y[t] - height * v[t] - product * s[t];
            const double leverage = 1.0 / length + x * x * per_spread + by_pixel * s[t] + v[t] * v[t] * per_power;
            const double apart = b[t] - left * v[t] - moved * s[t];
            gain[t] = by_pixel * per_height;
            residuals[t] = residual;
            freed[t] = std::max(1.0 - leverage, MIN_FREED);
            squares += residual * residual;
            power += apart * apart;
            stepped += apart * residual;
        }
        power = std::max(power, 1e-9);
        fits.shift[n] = bounded(product * per_height, -0.5 * length, 0.5 * length);
        fits.height[n] = height;
        fits.unit_height[n] = std::sqrt(ss / determinant);
        fits.rms[n] = std::sqrt(squares / (length - 4));
        fits.stepped[n] = -moved * per_height * stepped / power;
        fits.stepped_unit[n] = std::abs(moved * per_height) / std::sqrt(power);
    }
    return fits;
}

Observed observed(const CrossSection& section, const Crossings& found, ConstVector centre, const Fits& fits,
                  const Flags& chosen) {
    const int count = found.profiles.shape[0], length = found.profiles.shape[1];
    const Numbers share = shares(found);
    Observed seen = {Table(count, length), 0.0};
    Numbers across(length);
    Table rows(2, length);  // the shape, and its change with the width
    // sums of information, and of it and of the slopes by share
    double informed = 0.0, by_share = 0.0, by_square = 0.0, slopes = 0.0, slopes_by_share = 0.0;
    for (int n : places(chosen)) {
        distances(found, n, centre[n], across);
        look_up(section, n, across, rows.row(0), rows.row(1));
        for (int t = 0; t < length; ++t) {
            seen.heights(n, t) = rows(0, t) + fits.residuals(n, t) / fits.height[n];
            rows(1, t) *= -across[t];
        }
        remove_background(rows);
        const ConstVector v = rows.row(0), w = rows.row(1), residuals = fits.residuals.row(n);
        const double vv = dot(v, v), vw = dot(v, w), rv = dot(residuals, v), rw = dot(residuals, w);
        // less what the height makes of it
        const double information = (dot(w, w) - vw * vw / vv) * square(fits.height[n]);
        const double toward = (rw - rv * vw / vv) * fits.height[n];
        informed += information;
        by_share += information * share[n];
        by_square += information * square(share[n]);
        slopes += toward;
        slopes_by_share += toward * share[n];
    }
    const double middle = by_share / std::max(informed, 1e-9);
    const double prior = square(central(selected(fits.rms, chosen)) / TAPER_STD);
    const double variance = by_square - 2.0 * middle * by_share + middle * middle * informed;
    seen.taper = bounded((slopes_by_share - middle * slopes) / std::max(variance + prior, 1e-9), -MAX_TAPER, MAX_TAPER);
    return seen;
}

}  // namespace vbaa::detect
