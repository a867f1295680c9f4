// Centreline of the antenna from its ribbon: what is kept, and standard deviations.
#include "detect/ribbon_line.hpp"

#include "smooth.hpp"

namespace vbaa::detect {

namespace {

constexpr double SEEN = 0.5;    // least probability
constexpr double UNSURE = 0.4;  // part of the width up to which a point must be known
constexpr int MARGIN_PX = 2;    // dropped on either side of a gap: they show part of what hides the antenna
// Standard deviations of a profile by which a residual pattern common to the whole line displaces it, if the pattern's
// variance equals the noise's.
constexpr double LEFT = 2.5;
// Without colours, light from one side looks like a shift: part of the width per share of such light in the ribbon's
// brightness.
constexpr double LOPSIDED = 0.045;
// Light, width and blur are never exactly the model's. The errors that neighbours share in their scatter measure how
// far that moves the whole line: MISFIT of their standard deviation, where their power exceeds NOISE_ALONE.
constexpr double MISFIT = 6.0, NOISE_ALONE = 0.6;

// Mask of the ribbon's profiles that are kept for the line.
Flags kept_of(const Crossings& found, const Ribbon& ribbon, double width_px) {
    const double half = 0.5 * (found.profiles.shape[1] - 1);
    return each(found.inside.size(), [&](int n) {
        return found.inside[n] && ribbon.seen[n] > SEEN && ribbon.sigma_px[n] < UNSURE * width_px &&
               std::abs(ribbon.centre[n]) < half - 2.0;
    });
}

// The smooth curve through the kept points, along the profiles, px: the path may be off by what the ribbon's own course
// is too stiff for.
Numbers smooth_course(const Crossings& found, const Ribbon& ribbon, const Flags& kept) {
    const int all = kept.size();
    const double spread = std::max(median(selected(ribbon.sigma_px, kept)), 0.02);
    const Numbers across = each(all, [&](int n) { return ribbon.centre[n] * found.side[n] / found.stretch[n]; });
    const Numbers weights =
        each(all, [&](int n) { return kept[n] ? 1.0 / square(std::max(ribbon.sigma_px[n], 0.02)) : 0.0; });
    Numbers curve = fit_smooth(shares(found), across, weights, {6.0 * spread, 6.0 * spread}, CURVE_PIECES, 1e-6).values;
    for (int n = 0; n < all; ++n) curve[n] *= found.side[n] * found.stretch[n];
    return curve;
}

// Sets the line's standard deviations by the scatter of the kept points about the smooth course. Neighbouring points
// reveal, unlike a profile's pixels, by how much filtered noise or an inexact model moves the line; errors that
// neighbours share are measured on means of runs.
void calibrate(const Crossings& found, const Ribbon& ribbon, const RibbonMeasuring& how, FittedLine& line) {
    const std::vector<int> kept = places(line.kept);
    const int count_kept = static_cast<int>(kept.size());
    Numbers off = each(count_kept, [&](int k) {
        const int n = kept[k];
        return (line.centre[n] - line.course[n]) / (found.stretch[n] * std::max(ribbon.sigma_px[n], 1e-9));
    });
    double power = LIKELY_POINTS;
    for (double each : off) power += square(each);
    const double overall = power / (LIKELY_POINTS + count_kept);
    const Numbers excess = each(count_kept, [&](int k) { return square(off[k]) - overall; });
    const Numbers near = running_mean(excess, NEAR_POINTS, Beyond::end_value);
    line.sigma_px = ribbon.sigma_px;
    for (int k = 0; k < count_kept; ++k) {
        const double scale = std::sqrt(0.5 * (overall + std::max(overall + near[k], 0.0)));
        line.sigma_px[kept[k]] *= scale;
        off[k] /= scale;
    }
    const double factor = shared_factor(off, each(count_kept, [](int) { return 1.0; }));
    // degrees of freedom with which the curve follows the points' errors
    const double free = (CURVE_PIECES + 2.0) * std::max(factor, 1.0);
    const double freed = std::sqrt(count_kept / std::max(count_kept - free, 0.5 * count_kept));
    for (double& each : line.sigma_px) each *= freed;
    const double misfit = MISFIT * std::sqrt(std::max(overall * factor - NOISE_ALONE, 0.0));
    double one_sided = 0.0, whole = 1e-12;
    for (int n : kept)
        for (int k = 0; k < SHADES; ++k) {
            whole += square(ribbon.shades(n, k));
            if (k == 1 || k > 2) one_sided += square(ribbon.shades(n, k));
        }
    const double pulled = how.channels > 1 ? 0.0 : LOPSIDED * std::sqrt(one_sided / whole) * how.width_px;
    const Numbers shared = each(line.kept.size(), [&](int n) {
        const double left = LEFT * std::sqrt(found.profiles.shape[1] * ribbon.pattern) * ribbon.sigma_px[n];
        return std::hypot(std::hypot(misfit * ribbon.shared_px[n], left), pulled);
    });
    line.effective_px = each(line.kept.size(), [&](int n) {
        return std::sqrt(square(line.sigma_px[n]) * std::max(factor, 1.0) + SHARED_RUN * square(shared[n]));
    });
    for (int n = 0; n < line.kept.size(); ++n) line.sigma_px[n] = std::hypot(line.sigma_px[n], shared[n]);
}

// Cross-section of the antenna near its visible end, in the strongest channel, over its height there.
CrossSection end_section(const Ribbon& ribbon, const Flags& kept, int reach_px) {
    std::vector<int> last = places(kept);
    if (last.size() > END_PROFILES) last.erase(last.begin(), last.end() - END_PROFILES);
    std::array<double, SHADES> mean = {};
    for (int n : last)
        for (int k = 0; k < SHADES; ++k) mean[k] += ribbon.shades(n, k) / static_cast<double>(last.size());
    double height = 1e-12;
    for (double each : mean) height += square(each);
    const Table shades = shade_table(ribbon.width_px, ribbon.blur_px, reach_px);
    CrossSection section = {Table(shades.shape[0], 1), Table(shades.shape[0], 1)};
    for (int r = 0; r < shades.shape[0]; ++r) {
        const auto channel_sum = [&](ShadeKind kind) {
            const double* const of = &shades(r, kind * LANES);
            double sum = mean[0] * ((kind == VALUE ? 1.0 : 0.0) - of[0] - of[1]);
            for (int k = 1; k < SHADES; ++k) sum += mean[k] * of[shade_column(k)];
            return sum / std::sqrt(height);
        };
        section.values(r, 0) = channel_sum(VALUE), section.slopes(r, 0) = channel_sum(BY_DISTANCE);
    }
    return section;
}

}  // namespace

std::optional<MeasuredLine> measured_ribbon(const Picture& picture, ConstMatrix path_px, const RibbonMeasuring& how) {
    std::vector<Crossings> channels;
    channels.reserve(how.channels);
    for (int c = 0; c < how.channels; ++c) channels.push_back(crossings(picture, path_px, how.half, 1.0, c));
    if (count(channels[0].inside) < LEAST_PROFILES) return {};
    const Ribbon ribbon = fitted_ribbon(channels, how.width_px, how.blur_px, how.priors);
    const Crossings& found = channels[ribbon.strongest];
    FittedLine line = {ribbon.centre,
                       Numbers(),
                       Numbers(),
                       Numbers(),
                       kept_of(found, ribbon, how.width_px),
                       ribbon.height,
                       ribbon.noise,
                       ribbon.width_px / how.width_px,
                       true,
                       0.0};
    if (!any(line.kept)) return {};
    line.course = smooth_course(found, ribbon, line.kept);
    for (int n = 0; n < line.kept.size(); ++n) {
        const double off = std::abs(line.centre[n] - line.course[n]);
        line.kept[n] = line.kept[n] && off < std::max(STRAY * ribbon.sigma_px[n] * found.stretch[n], STRAY_PX);
    }
    line.kept = without_margins(line.kept, MARGIN_PX);
    if (!any(line.kept)) return {};
    calibrate(found, ribbon, how, line);
    line.sure = total(selected(ribbon.seen, line.kept)) / count(line.kept);
    Evidence seen = evidence(found, line);
    const Look look = {end_section(ribbon, line.kept, how.half + 2), how.half, ribbon.noise, 1.0, ribbon.strongest};
    const VisibleEnd end = visible_end(picture, seen.guide, line.kept, look);
    return MeasuredLine{std::move(line), std::move(seen), end};
}

}  // namespace vbaa::detect
