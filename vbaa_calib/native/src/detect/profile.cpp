// Centreline of the antenna from profiles: learning the cross-section, fitting it, selection, and standard deviations.
#include "detect/profile.hpp"

#include "order.hpp"

namespace vbaa::detect {

namespace {

constexpr double SEEN_RATIO = 4.5;  // least height over its standard deviation for a profile to count as seen
constexpr double LEAST_CLEAN =
    0.3;                      // with fewer undisturbed ones, disturbed ones are kept with larger standard deviations
constexpr int MARGIN_PX = 2;  // dropped on either side of a gap: they show part of what hides the antenna
constexpr int TRAINING_PROFILES = 100;  // that the cross-section is learned from, about
constexpr double ALIKE = 0.8;           // length of the mean phase on the pixel grid above which profiles lie alike
constexpr double LOPSIDED = 0.012;      // difference of its sides, over its height, that is too much for a broad line
constexpr double FLANKED_PX = 5.0;      // that is broader than this: its two edges are measured
constexpr double PULLED = 0.05;         // part of the width by which a faint highlight may displace it, at two σ
// An object's edge next to the antenna shifts about this many neighbouring points alike. The mean shift by a step of
// the background behind the line is added as an error where it exceeds EDGE_NOTICED of its own standard deviations.
constexpr int EDGE_RUN = 21;
constexpr double EDGE_NOTICED = 3.0;
constexpr int STRAY_PIECES = 24;     // of the curve that strays are detected by
constexpr int RUN = 16;              // neighbours: their mean is their common error
constexpr double LIKELY_RUNS = 4.0;  // that scatter as predicted are added to those that are seen

// The fitted lines.
struct Lines {
    Numbers centre;  // (N,) along the profiles from the path, px
    Fits fits;       // the last fit
    CrossSection section;
    double half_width_px;  // of the cross-section
    double noise;          // of a pixel, grey levels
    Numbers usual;         // (N,) height that the line should have
    Numbers shared;        // (N,) error of the place that neighbours share, px
};

// (N,) widths of an antenna that is not uniform, px.
Numbers widths(const Crossings& found, const Measuring& how) {
    const Array<double, 1> share = shares(found);
    return each(share.size(), [&](int n) { return how.width_px * (1.0 + how.taper * (share[n] - 0.5)); });
}

// Distances in widths of its line, which blur keeps from becoming as thin as the antenna.
Crossings in_widths(Crossings found, const Measuring& how) {
    constexpr double FULL_WIDTH = 2.355;  // of a blur at half its height, over its deviation
    const double blur_px = FULL_WIDTH * std::hypot(how.shapes.blur_px, PIXEL_BLUR_PX);
    const double middle = std::hypot(how.width_px, blur_px);
    const Numbers width_px = widths(found, how);
    const double growth_px = how.width_px * how.taper / length_px(found);
    for (int n = 0; n < width_px.size(); ++n) {
        const double width = std::sqrt(square(width_px[n]) + square(blur_px));
        in_width(found, n, width / middle, width_px[n] * growth_px / (width * width));
    }
    return found;
}

// (N,) heights of its line, of which blur leaves less where it is thinner, over that in the middle.
Numbers heights(const Crossings& found, const Measuring& how) {
    const double blur_px = std::sqrt(8.0) * std::hypot(how.shapes.blur_px, PIXEL_BLUR_PX);
    const Numbers width_px = widths(found, how);
    return each(width_px.size(),
                [&](int n) { return std::erf(width_px[n] / blur_px) / std::erf(how.width_px / blur_px); });
}

// The picture's noise from the profiles' residuals (M,), of which more than half may be disturbed.
double noise_of(const Numbers& rms, double quiet) { return rms.size() ? quantile(rms, QUIET) / quiet + 1e-6 : 1e-6; }

double noise_of(const Fits& fits, const Crossings& found, double quiet) {
    return noise_of(selected(fits.rms, found.inside), quiet);
}

// Profiles that show a clear line, as high as most, and nothing else.
Flags training_profiles(const Fits& fits, const Crossings& found, double quiet) {
    const double noise = noise_of(fits, found, quiet);
    const int all = found.inside.size();
    Flags good = each(all, [&](int n) {
        return found.inside[n] && fits.height[n] > SEEN_RATIO * noise * fits.unit_height[n] &&
               std::abs(fits.shift[n]) < 1.5;
    });
    if (!any(good)) return good;
    const double typical = median(selected(fits.height, good));
    for (int n = 0; n < all; ++n) good[n] = good[n] && fits.height[n] > 0.4 * typical && fits.height[n] < 2.5 * typical;
    Flags calm = each(all, [&](int n) { return good[n] && fits.rms[n] < DISTURBED_RMS * noise + 0.02 * typical; });
    return count(calm) >= 0.3 * count(good) ? calm : good;
}

// Length of the mean phase on the pixel grid of the chosen profiles.
double phase_alike(const Crossings& some, const Flags& chosen) {
    double cosines = 0.0, sines = 0.0;
    for (int n : places(chosen)) {
        cosines += std::cos(2.0 * M_PI * some.across(n, 0));
        sines += std::sin(2.0 * M_PI * some.across(n, 0));
    }
    return std::hypot(cosines, sines) / count(chosen);
}

// A learned symmetric cross-section, with the line's course.
struct Learned {
    CrossSection section;
    Crossings found;        // in widths of a line that broadens
    Numbers curve;          // (N,) the line's course, px
    double pulled = 0.0;    // px by which a highlight may displace the line
    double lopsided = 0.0;  // the same for a broad line too lopsided for a symmetric cross-section
};

// Learns the cross-section from some of the profiles in three steps: an antenna in focus; one at the measured blur; any
// symmetric shape. Where all profiles lie alike on the pixel grid, a free shape and a shift cannot be separated, and
// the second step's result is kept. The shape is broader where the antenna is nearer to the camera.
Learned learned_section(const Crossings& found, const Measuring& how) {
    const int count_all = found.along.size(), reach = found.profiles.shape[1] / 2 + 2;
    Learned learned = {how.shapes.ordinary, found, Numbers(count_all)};
    Crossings some = every(found, std::max(1, count_all / TRAINING_PROFILES));
    Numbers base(some.along.size());
    const double whole = std::max(found.along[count_all - 1], 1e-6);
    for (int step = 0; step < 2; ++step) {
        const Fits fits = fit(learned.section, some, base);
        const Flags chosen = training_profiles(fits, some, how.quiet);
        if (count(chosen) < 4) break;
        if (step) {
            // not at first: the path is good enough to determine the blur
            const Numbers at = each(base.size(), [&](int n) { return some.along[n] / whole; });
            const Numbers weights = each(base.size(), [&](int n) { return chosen[n] ? 1.0 : 0.0; });
            SmoothCurve course = fit_smooth(at, fits.shift, weights, {1.0, 0.3}, 12, 1e-3);
            learned.curve = smooth_at(course, shares(found));
            base = std::move(course.values);
        }
        const Observed seen = observed(learned.section, some, base, fits, chosen);
        // at first profiles where the line is much broader or thinner are not chosen: no bend is inferred for them
        const Taper taper = {seen.taper.part, step ? seen.taper.bend : 0.0};
        learned.found = tapered(std::move(learned.found), taper);
        some = tapered(std::move(some), taper);
        const Binned by_distance = binned(some, base, seen.heights, chosen, reach);
        if (step == 0 || phase_alike(some, chosen) >= ALIKE) {
            learned.section = nearest(by_distance, how.shapes);
            continue;
        }
        learned.section = learn(by_distance, how.shapes);
        Numbers noise = selected(fits.rms, chosen);
        const Numbers height = selected(fits.height, chosen);
        for (int n = 0; n < noise.size(); ++n) noise[n] /= height[n];
        const double sides = lopsided(by_distance, median(noise));
        learned.pulled = PULLED * how.width_px * bounded((sides - 0.5 * LOPSIDED) / LOPSIDED, 0.0, 1.0);
        learned.lopsided = how.width_px > FLANKED_PX && sides > LOPSIDED ? learned.pulled : 0.0;
    }
    return learned;
}

// Lines fitted with one symmetric cross-section.
Lines symmetric_lines(Learned learned, const Measuring& how) {
    const Crossings& found = learned.found;
    const int all = found.along.size();
    Lines lines;
    lines.fits = fit(learned.section, found, learned.curve);
    const Fits& fits = lines.fits;
    const double noise = lines.noise = noise_of(fits, found, how.quiet);
    const Numbers seen = selected(
        fits.height, each(all, [&](int n) {
            return found.inside[n] && fits.height[n] > SEEN_RATIO * std::max(fits.rms[n], noise) * fits.unit_height[n];
        }));
    const double usual = seen.size() ? median(seen) : 0.0;
    lines.centre = each(all, [&](int n) { return learned.curve[n] + fits.shift[n]; });
    lines.usual = each(all, [&](int) { return usual; });
    if (how.taper != 0.0) {
        const Numbers height = heights(found, how);
        for (int n = 0; n < all; ++n) lines.usual[n] *= height[n];
    }
    lines.shared = each(all, [&](int) { return 0.5 * learned.pulled; });
    lines.half_width_px = half_width_px(learned.section);
    lines.section = std::move(learned.section);
    return lines;
}

// Masks of the profiles: those that show the antenna well enough, those of them without anything else next to it, and
// those that show it at all.
struct Selection {
    Flags kept, clean, seen;
};

Selection selection(const Crossings& found, const Lines& lines) {
    const Fits& fits = lines.fits;
    const double half = 0.5 * (found.profiles.shape[1] - 1), noise = lines.noise;
    const int all = found.inside.size();
    Flags seen = each(all, [&](int n) {
        return found.inside[n] && std::abs(lines.centre[n]) < half - 2.0 &&
               fits.height[n] > SEEN_RATIO * std::max(fits.rms[n], noise) * fits.unit_height[n];
    });
    if (!any(seen)) return {seen, seen, seen};
    for (int n = 0; n < all; ++n)
        seen[n] = seen[n] && fits.height[n] > 0.3 * lines.usual[n] && fits.height[n] < 3.0 * lines.usual[n];
    const Flags clean = each(all, [&](int n) { return seen[n] && fits.rms[n] < DISTURBED_RMS * noise; });
    if (count(clean) >= LEAST_CLEAN * all) return {clean, clean, seen};
    return {each(all, [&](int n) { return seen[n] && fits.rms[n] < 4.0 * noise + 0.1 * lines.usual[n]; }), clean, seen};
}

// (N,) standard deviation across the antenna, larger where a profile is noisier than most.
Numbers deviations(const Crossings& found, const Fits& fits, const Flags& chosen) {
    const double usual = total(selected(fits.rms, chosen)) / count(chosen);
    return each(fits.rms.size(),
                [&](int n) { return fits.unit_shift[n] * std::max(fits.rms[n], usual) / found.stretch[n]; });
}

// (N,) by how much an edge of the background along the antenna may shift the points, px.
Numbers edge_doubt(const Crossings& found, const Lines& lines, const Flags& seen) {
    const int all = seen.size();
    const auto mean_where_seen = [&](auto value) {
        const Numbers values = each(all, [&](int n) { return seen[n] ? value(n) : 0.0; });
        return running_mean(values, EDGE_RUN, Beyond::zeros);
    };
    const Fits& fits = lines.fits;
    const Numbers share = mean_where_seen([](int) { return 1.0; });
    const Numbers moved = mean_where_seen([&](int n) { return fits.stepped[n]; });
    const Numbers noise = mean_where_seen([&](int n) { return square(lines.noise * fits.stepped_unit[n]); });
    return each(all, [&](int n) {
        const double here = std::max(share[n], 1e-9), off = std::abs(moved[n] / here);
        // running sums leave rounding below zero
        const double variance = std::max(noise[n] / here, 0.0) / std::max(EDGE_RUN * share[n], 1.0);
        return off > EDGE_NOTICED * std::sqrt(variance) ? off / found.stretch[n] : 0.0;
    });
}

Numbers together(const Numbers& one, const Numbers& other) {
    return each(one.size(), [&](int n) { return std::sqrt(square(one[n]) + square(other[n])); });
}

// How a course is fitted: in two rounds, of 6 and `second_scale` typical deviations.
struct Smoothing {
    double second_scale;
    int pieces;
    double stiffness;
};

// The smooth course of the kept points with deviations `all_px`, of which `sigma` is typical.
Numbers smooth_course(const Crossings& found, const Lines& lines, const Numbers& sigma, const Numbers& all_px,
                      const Flags& kept, const Smoothing& how) {
    const double spread = std::max(median(selected(sigma, kept)), 0.02);
    const Numbers weights =
        each(kept.size(), [&](int n) { return kept[n] ? 1.0 / square(std::max(all_px[n], 0.02)) : 0.0; });
    return fit_smooth(shares(found), lines.centre, weights, {6.0 * spread, how.second_scale * spread}, how.pieces,
                      how.stiffness)
        .values;
}

// Sets the line's standard deviations by the scatter of the kept points about a smooth curve. Neighbouring points
// reveal, unlike a profile's residuals, by how much filtered noise or an inexact shape moves the line; errors that
// neighbours share are measured on means of runs.
void calibrate(const Crossings& found, const Lines& lines, const Numbers& edge, FittedLine& line) {
    const Numbers &sigma = line.sigma_px, doubt = together(edge, lines.shared);
    Numbers all_px = together(sigma, doubt);
    for (double& each : all_px) each = std::max(each, 1e-9);
    const Numbers curve = smooth_course(found, lines, sigma, all_px, line.kept, {6.0, CURVE_PIECES, 1e-6});
    const std::vector<int> kept = places(line.kept);
    const int count_kept = static_cast<int>(kept.size());
    const double freed = count_kept / std::max(count_kept - CURVE_PIECES - 2.0, 0.5 * count_kept);
    Numbers off = each(count_kept, [&](int k) {
        return (lines.centre[kept[k]] - curve[kept[k]]) / (found.stretch[kept[k]] * all_px[kept[k]]);
    });
    // where an edge may shift points, their scatter says little of the noise
    const Numbers trusted = each(count_kept, [&](int k) { return square(sigma[kept[k]] / all_px[kept[k]]); });
    double power = LIKELY_POINTS, informed = LIKELY_POINTS;
    for (int k = 0; k < count_kept; ++k) power += trusted[k] * square(off[k]) * freed, informed += trusted[k];
    const double overall = power / informed;
    Numbers calibrated = sigma;
    for (int k : kept) calibrated[k] *= std::sqrt(overall);
    for (double& each : off) each /= std::sqrt(overall);
    const double factor = std::max(shared_factor(off, trusted), 1.0);
    line.effective_px = each(sigma.size(), [&](int n) {
        return std::sqrt(square(calibrated[n]) * factor + EDGE_RUN * square(edge[n]) +
                         SHARED_RUN * square(lines.shared[n]));
    });
    line.sigma_px = together(calibrated, doubt);
}

// The kept part of the lines, with standard deviations.
FittedLine fitted_line(const Crossings& found, const Lines& lines, const Measuring& how) {
    const int all = lines.centre.size();
    const Selection chosen = selection(found, lines);
    FittedLine line = {lines.centre, lines.centre,
                       Numbers(all), Numbers(all),
                       chosen.kept,  lines.fits.height,
                       lines.noise,  lines.half_width_px / half_width_px(how.shapes.ordinary),
                       false,        1.0};
    if (!any(line.kept)) return line;
    line.sigma_px = deviations(found, lines.fits, any(chosen.clean) ? chosen.clean : chosen.kept);
    const Numbers edge = edge_doubt(found, lines, chosen.seen);
    // points that do not lie on one smooth curve
    const Numbers all_px = together(line.sigma_px, together(edge, lines.shared));
    line.course = smooth_course(found, lines, all_px, all_px, line.kept, {4.0, STRAY_PIECES, 1e-4});
    for (int n = 0; n < all; ++n) {
        const double off = std::abs(lines.centre[n] - line.course[n]);
        line.kept[n] = line.kept[n] && off < std::max(STRAY * all_px[n] * found.stretch[n], STRAY_PX);
    }
    line.kept = without_margins(line.kept, MARGIN_PX);
    if (!any(line.kept)) return line;
    calibrate(found, lines, edge, line);
    return line;
}

constexpr double ROOT = 0.33;  // the beginning of the path, as a part of it: the antenna starts at the clamp
// Places behind the last one that is seen lie beyond it.
Flags visibility_of(const Flags& kept, const Flags& inside) {
    Flags found = each(kept.size(), [&](int n) -> unsigned char {
        return kept[n] ? SEEN : inside[n] ? HIDDEN : OUTSIDE;
    });
    for (int n = kept.size() - 1; !kept[n]; --n)
        if (found[n] == HIDDEN) found[n] = BEYOND;
    return found;
}

}  // namespace

Flags without_margins(const Flags& kept, int margin) {
    const int count = kept.size();
    const auto around = [&](const Flags& flags, int n, int reach, bool flag) {
        const int begin = std::max(n - reach, 0), end = std::min(n + reach + 1, count);
        return std::find(flags.begin() + begin, flags.begin() + end, flag) != flags.begin() + end;
    };
    const Flags grown = each(count, [&](int n) { return around(kept, n, 1, true); });
    const Flags filled = each(
        count, [&](int n) { return kept[n] || (n > 0 && n < count - 1 && grown[n - 1] && grown[n] && grown[n + 1]); });
    Flags inner = each(count, [&](int n) { return kept[n] && !around(filled, n, margin, false); });
    // a few isolated ones belong to another thing
    for (int n = 0, first = 0; n < count; n = first = n + 1) {
        while (n < count && filled[n]) ++n;
        if (n - first < LEAST_PROFILES)
            std::fill(inner.begin() + first, inner.begin() + n, static_cast<unsigned char>(0));
    }
    return inner;
}

Evidence evidence(const Crossings& found, const FittedLine& line) {
    const Flags& kept = line.kept;
    const double whole = kept.size(), seen = count(kept);
    Evidence evidence = {};
    evidence.everywhere = moved(found, line.centre);
    evidence.guide = moved(found, line.course);
    evidence.visibility = visibility_of(kept, found.inside);
    evidence.seen = seen / whole;
    evidence.inside = count(found.inside) / whole;
    int root = 0, root_seen = 0;
    for (int n = 0; n < kept.size() && found.along[n] < ROOT * found.along[kept.size() - 1]; ++n, ++root)
        root_seen += kept[n];
    evidence.root = static_cast<double>(root_seen) / root;
    evidence.height = median(selected(line.height, kept));
    return evidence;
}

double shared_factor(const Numbers& normalised, const Numbers& trusted) {
    const int all = normalised.size();
    Numbers sums(all + 1);
    for (int k = 0; k < all; ++k) sums[k + 1] = sums[k] + normalised[k];
    double power = LIKELY_RUNS, informed = LIKELY_RUNS;
    for (int k = 0; k + 3 * RUN < all + 1; ++k) {
        // second differences, which a curve that is too stiff or too supple changes little
        const double bend = (sums[k + 3 * RUN] - 3.0 * sums[k + 2 * RUN] + 3.0 * sums[k + RUN] - sums[k]) / RUN;
        const double weight = trusted[k + RUN + RUN / 2] / RUN;
        power += weight * RUN / 6.0 * bend * bend;
        informed += weight;
    }
    return power / informed;
}

std::optional<MeasuredLine> measured(const Picture& picture, ConstMatrix path_px, const Measuring& how) {
    Crossings found = crossings(picture, path_px, how.half, how.sign);
    if (count(found.inside) < LEAST_PROFILES) return {};
    if (how.taper != 0.0) found = in_widths(std::move(found), how);
    Learned learned = learned_section(found, how);
    const double lopsided = learned.lopsided;
    Lines lines = symmetric_lines(std::move(learned), how);
    FittedLine line = fitted_line(found, lines, how);
    if (!any(line.kept)) return {};
    Evidence seen = evidence(found, line);
    const Look look = {std::move(lines.section), how.half, line.noise, how.sign};
    const VisibleEnd end = visible_end(picture, seen.guide, line.kept, look);
    return MeasuredLine{std::move(line), std::move(seen), end, lopsided};
}

}  // namespace vbaa::detect
