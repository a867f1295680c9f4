// The antenna's cross-section: tables, learning, and the linear fit of every profile.
#include "detect/line_shape.hpp"

#include <array>

#include "lanes.hpp"

namespace vbaa::detect {

namespace {

constexpr int BINS_PER_PX = 4;
constexpr std::array<double, 3> WIDTHS = {0.85, 1.0, 1.2};  // tried, as parts of the antenna's width
constexpr std::array<double, 9> BLURS_PX = {0.45, 0.6, 0.8, 1.0, 1.3, 1.7, 2.2, 3.0, 4.0};  // tried
constexpr double KNOT_PX = 0.85;       // spacing of the splines' knots: finer than the point spread of an ordinary lens
constexpr double BEND_PENALTY = 1e-3;  // of a learned shape's coefficients, over the mean weight of a bin

// Profiles padded with zeros to whole lanes.
struct Pixels {
    int length, padded;
    double per_spread;
    Table kept;                   // (2, padded)
    const double *ones, *offset;  // where there are pixels, and their distance from the middle

    explicit Pixels(int pixels) : length(pixels), padded(whole_lanes(pixels)), kept(2, padded) {
        per_spread = 12.0 / (length * (square(length) - 1.0));
        for (int t = 0; t < length; ++t) kept(0, t) = 1.0, kept(1, t) = t - 0.5 * (length - 1);
        ones = kept.row(0).data, offset = kept.row(1).data;
    }
    // Subtracts level and slope from a row.
    void remove_background(double* row) const {
        Lanes level = {}, slope = {};
        for (int t = 0; t < padded; t += LANES) {
            level += load(row + t) * load(ones + t);
            slope += load(row + t) * load(offset + t);
        }
        const double mean = sum(level) / length, rise = sum(slope) * per_spread;
        for (int t = 0; t < padded; t += LANES)
            store(row + t, (load(row + t) - mean) * load(ones + t) - rise * load(offset + t));
    }
};

Lanes clamped(Lanes values, double low, double high) {
    const Lanes raised = where_positive(values - low, values, low);
    return where_positive(high - raised, raised, high);
}

// A cross-section and its derivative at distances (T,) from the centre, px: into (T,) each.
void look_up(const CrossSection& section, ConstVector across, double* __restrict value, double* __restrict slope) {
    const int last = section.values.shape[0] - 1, count = across.shape[0];
    const double *const values = section.values.begin(), *const slopes = section.slopes.begin();
    for (int t = 0; t < count; ++t) {
        const Place at(across[t], last);
        value[t] = (1.0 - at.far) * values[at.row] + at.far * values[at.row + 1];
        slope[t] = (1.0 - at.far) * slopes[at.row] + at.far * slopes[at.row + 1];
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

Table product(const Table& table, ConstVector coefficients) {
    Table values(Unset{}, table.shape[0], 1);
    for (int r = 0; r < table.shape[0]; ++r) values.values[r] = dot(table.row(r), coefficients);
    return values;
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
    return {std::move(line), std::move(slopes)};
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
    made.blur_px = blur_px;
    made.bins = even_splines(spline, inner, reach_px, BINS_PER_PX, 0.5, bins);
    made.values = even_splines(spline, inner, reach_px, PER_PX, 0.0, rows);
    made.slopes = even_splines(spline_slope, inner, reach_px, PER_PX, 0.0, rows);
    for (double& slope : made.slopes) slope *= static_cast<double>(inner) / reach_px;
    made.ordinary = expected(width_px, blur_px, reach_px);
    for (double part : WIDTHS)
        for (double blur : BLURS_PX) made.blurred.push_back(expected(width_px * part, blur, reach_px));
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
    const CrossSection* best = known.blurred.data();
    double most = -INFINITY;
    for (const CrossSection& section : known.blurred) {
        const Numbers shape =
            each(bins, [&](int b) { return section.values.values[(2 * b + 1) * PER_PX / (2 * BINS_PER_PX)]; });
        const double middle = dot(shape, seen.number) / whole;
        double product = 0.0, power = 0.0;
        for (int b = 0; b < bins; ++b) {
            product += (shape[b] - middle) * seen.number[b] * (seen.mean[b] - offset);
            power += square(shape[b] - middle) * seen.number[b];
        }
        // the height that fits each shape best is left free
        const double match = product * product / std::max(power, 1e-9);
        if (match > most) best = &section, most = match;
    }
    return *best;
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
            for (int j = std::max(i - 3, 0); j <= i; ++j) matrix(i, j) += weight * bin[j];  // others do not overlap
        }
    }
    constexpr std::array<double, 3> second = {1.0, -2.0, 1.0};
    const double whole = total(seen.number), bend = BEND_PENALTY * whole / count;
    // constant beyond the reach of all profiles, as with lines that are crossed at a slant
    const double few = 0.01 * whole / several;
    std::vector<std::array<int, 2>> level;
    for (int i = several / 2; i < several; ++i)
        if (matrix(i, i) < few) level.push_back({i, i - 1});
    for (int i = several / 2; i >= 0; --i)
        if (matrix(i, i) < few) level.push_back({i, i + 1});
    for (const auto& [i, inner] : level) {
        matrix(i, i) += whole, matrix(inner, inner) += whole;
        matrix(std::max(i, inner), std::min(i, inner)) -= whole;
    }
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
    return {std::move(shape), std::move(slope)};
}

Fits fit(const CrossSection& section, const Crossings& found, ConstVector centre) {
    const int count = found.profiles.shape[0], length = found.profiles.shape[1];
    const Pixels pixels(length);
    const int padded = pixels.padded;
    Fits fits;
    for (Numbers* each :
         {&fits.shift, &fits.height, &fits.unit_height, &fits.unit_shift, &fits.rms, &fits.stepped, &fits.stepped_unit})
        *each = Numbers(Unset{}, count);
    fits.residuals = Table(Unset{}, count, padded);
    // shape, change with its place, grey levels and a step: their background is removed
    Table rows(4, padded);
    Numbers across(padded);
    double *const shape = rows.row(0).data, *const change = rows.row(1).data;
    double *const levels = rows.row(2).data, *const edge = rows.row(3).data;
    for (int n = 0; n < count; ++n) {
        distances(found, n, centre[n], Vector(across.begin(), {length}));
        look_up(section, across, shape, change);
        std::copy_n(found.profiles.row(n).data, length, levels);
        const double by_centre = -found.side[n] / found.stretch[n];
        for (int t = 0; t < padded; t += LANES) {
            store(change + t, by_centre * load(change + t));
            store(edge + t, clamped(load(&across[t]), -1.0, 1.0));
        }
        for (int i = 0; i < 4; ++i) pixels.remove_background(rows.row(i).data);
        Lanes sums[7] = {};
        for (int t = 0; t < padded; t += LANES) {
            const Lanes v = load(shape + t), s = load(change + t), y = load(levels + t), b = load(edge + t);
            sums[0] += v * v, sums[1] += v * s, sums[2] += s * s;
            sums[3] += v * y, sums[4] += s * y, sums[5] += v * b, sums[6] += s * b;
        }
        const double vv = sum(sums[0]), vs = sum(sums[1]), ss = sum(sums[2]), vy = sum(sums[3]), sy = sum(sums[4]);
        const double vb = sum(sums[5]), sb = sum(sums[6]), determinant = std::max(vv * ss - vs * vs, 1e-9);
        const double height = (ss * vy - vs * sy) / determinant, product = (vv * sy - vs * vy) / determinant;
        const double per_height = 1.0 / (std::abs(height) > 1e-6 ? height : 1e-6);
        // the step, with the effect of height and place removed
        const double moved = (vv * sb - vs * vb) / determinant, left = (ss * vb - vs * sb) / determinant;
        Lanes squares = {}, powers = {}, steps = {};
        for (int t = 0; t < padded; t += LANES) {
            const Lanes v = load(shape + t), s = load(change + t),
                        residual = load(levels + t) - height * v - product * s;
            const Lanes apart = load(edge + t) - left * v - moved * s;
            store(&fits.residuals(n, t), residual);
            squares += residual * residual, powers += apart * apart, steps += apart * residual;
        }
        fits.shift[n] = bounded(product * per_height, -0.5 * length, 0.5 * length);
        fits.height[n] = height;
        fits.unit_height[n] = std::sqrt(ss / determinant);
        fits.unit_shift[n] = std::sqrt(vv / determinant) * std::abs(per_height);
        fits.rms[n] = std::sqrt(sum(squares) / (length - 4));
        const double power = std::max(sum(powers), 1e-9);
        fits.stepped[n] = -moved * per_height * sum(steps) / power;
        fits.stepped_unit[n] = std::abs(moved * per_height) / std::sqrt(power);
    }
    return fits;
}

Observed observed(const CrossSection& section, const Crossings& found, ConstVector centre, const Fits& fits,
                  const Flags& chosen) {
    const int count = found.profiles.shape[0], length = found.profiles.shape[1];
    const Numbers share = shares(found);
    const Pixels pixels(length);
    Observed seen = {Table(count, length), {}};
    Numbers across(pixels.padded);
    Table rows(2, pixels.padded);  // the shape, and its change with the width
    double *const shape = rows.row(0).data, *const change = rows.row(1).data;
    double informed[3][3] = {}, slopes[3] = {};  // by the width, its taper, and the taper's bend
    for (int n : places(chosen)) {
        distances(found, n, centre[n], Vector(across.begin(), {length}));
        look_up(section, across, shape, change);
        const double* const residuals = fits.residuals.row(n).data;
        for (int t = 0; t < length; ++t) seen.heights(n, t) = shape[t] + residuals[t] / fits.height[n];
        for (int t = 0; t < pixels.padded; t += LANES) store(change + t, -load(&across[t]) * load(change + t));
        for (double* row : {shape, change}) pixels.remove_background(row);
        Lanes sums[5] = {};
        for (int t = 0; t < pixels.padded; t += LANES) {
            const Lanes v = load(shape + t), w = load(change + t), r = load(residuals + t);
            sums[0] += v * v, sums[1] += v * w, sums[2] += w * w, sums[3] += r * v, sums[4] += r * w;
        }
        const double vv = sum(sums[0]), vw = sum(sums[1]), ww = sum(sums[2]), rv = sum(sums[3]), rw = sum(sums[4]);
        // with the effect of the height removed
        const double information = (ww - vw * vw / vv) * square(fits.height[n]);
        const double toward = (rw - rv * vw / vv) * fits.height[n];
        const double along = share[n] - 0.5, terms[3] = {1.0, along, along * along - 1.0 / 12.0};
        for (int i = 0; i < 3; ++i) {
            slopes[i] += toward * terms[i];
            for (int j = 0; j < 3; ++j) informed[i][j] += information * terms[i] * terms[j];
        }
    }
    const double prior = std::max(square(central(selected(fits.rms, chosen)) / TAPER_STD), 1e-9);
    const double whole = std::max(informed[0][0], 1e-9);
    // with the effect of the width removed
    const auto left = [&](int i, int j) {
        return informed[i][j] - informed[i][0] * informed[0][j] / whole + (i == j ? prior : 0.0);
    };
    const auto pull = [&](int i) { return slopes[i] - informed[i][0] * slopes[0] / whole; };
    const double determinant = left(1, 1) * left(2, 2) - square(left(1, 2));
    seen.taper.part = bounded((left(2, 2) * pull(1) - left(1, 2) * pull(2)) / determinant, -MAX_TAPER, MAX_TAPER);
    seen.taper.bend = bounded((left(1, 1) * pull(2) - left(1, 2) * pull(1)) / determinant, -MAX_TAPER, MAX_TAPER);
    return seen;
}

}  // namespace vbaa::detect
