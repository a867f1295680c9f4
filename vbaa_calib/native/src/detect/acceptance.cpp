// Evidence for and against a fitted line.
#include "detect/acceptance.hpp"

#include "order.hpp"

namespace vbaa::detect {

namespace {

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
    // a few alone are another thing's
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

}  // namespace vbaa::detect
