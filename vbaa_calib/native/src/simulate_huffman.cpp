#include "simulate_huffman.hpp"

#include <cstring>

namespace vbaa::simulate {

namespace {

// How often each byte occurs, and the block's end.
using Counts = std::array<std::uint32_t, 257>;

// A symbol's code, its first bit lowest, and its length.
struct Code {
    std::uint32_t bits = 0, length = 0;
};

std::uint32_t reversed(std::uint32_t code, std::uint32_t length) {
    std::uint32_t found = 0;
    for (std::uint32_t i = 0; i < length; ++i) found = 2 * found + (code >> i) % 2;
    return found;
}

// Depths of the symbols' leaves in Huffman's tree; 0 of those that do not occur.
Counts depths_of(const Counts& counts) {
    std::vector<std::size_t> leaves;
    for (std::size_t symbol = 0; symbol < counts.size(); ++symbol)
        if (counts[symbol]) leaves.push_back(symbol);
    std::sort(leaves.begin(), leaves.end(),
              [&](std::size_t a, std::size_t b) { return counts[a] != counts[b] ? counts[a] < counts[b] : a < b; });
    // leaves, then the nodes above them, each as rare as the last one made or more frequent
    const int count = static_cast<int>(leaves.size());
    std::vector<std::uint32_t> weight(2 * count), depth(2 * count);
    std::vector<int> parent(2 * count);
    for (int k = 0; k < count; ++k) weight[k] = counts[leaves[k]];
    int leaf = 0, node = count;
    for (int made = count; made < 2 * count - 1; ++made) {
        for (int child = 0; child < 2; ++child) {
            const bool from_leaves = leaf < count && (node == made || weight[leaf] <= weight[node]);
            const int rarest = from_leaves ? leaf++ : node++;
            weight[made] += weight[rarest];
            parent[rarest] = made;
        }
    }
    for (int k = 2 * count - 3; k >= 0; --k) depth[k] = depth[parent[k]] + 1;
    Counts found = {};
    for (int k = 0; k < count; ++k) found[leaves[k]] = depth[k];
    return found;
}

// The canonical codes of symbols that occur so often.
std::array<Code, Counts().size()> codes_of(Counts counts) {
    constexpr std::uint32_t longest = 15;
    auto depths = depths_of(counts);
    while (*std::max_element(depths.begin(), depths.end()) > longest) {
        for (std::uint32_t& each : counts) each = (each + 1) / 2;  // rare symbols become more alike
        depths = depths_of(counts);
    }
    std::array<Code, Counts().size()> codes;
    std::uint32_t next = 0;
    for (std::uint32_t length = 1; length <= longest; ++length) {
        for (std::size_t symbol = 0; symbol < codes.size(); ++symbol)
            if (depths[symbol] == length) codes[symbol] = {reversed(next++, length), length};
        next <<= 1U;
    }
    return codes;
}

// Writes bits, the lowest ones first.
struct Bits {
    std::uint8_t* to;
    std::uint64_t waiting = 0;
    std::uint32_t count = 0;

    void put(std::uint64_t bits, std::uint32_t length) {
        waiting |= bits << count;
        count += length;
    }
    // the whole bytes, of 63 bits at most
    void flush() {
        for (std::uint32_t i = 0; i < 8; ++i) to[i] = static_cast<std::uint8_t>(waiting >> (8 * i));
        to += count / 8;
        waiting >>= count - count % 8;
        count %= 8;
    }
};

}  // namespace

Array<std::uint8_t, 1> huffman_deflated(View<const std::uint8_t, 1> bytes) {
    // bytes that share their codes, for the light changes across a picture; those of a block's codes, and more
    constexpr int each = 65536, header = 512, length_bits = 4;
    const int size = bytes.size(), blocks = std::max((size + each - 1) / each, 1);
    Array<std::uint8_t, 1> found(Unset{}, size + size / 8 * 7 + size % 8 + header * blocks);
    Bits out = {found.values.data()};
    for (int block = 0; block < blocks; ++block) {
        const auto own = bytes.part(block * each, std::min(each, size - block * each));
        std::array<Counts, 4> several = {};  // a count that was just written is waited for
        for (int i = 0; i < own.size(); ++i) ++several[i % 4][own[i]];
        for (int k = 1; k < 4; ++k)
            for (std::size_t byte = 0; byte < several[k].size(); ++byte) several[0][byte] += several[k][byte];
        several[0].back() = 1;
        const auto codes = codes_of(several[0]);
        out.put(block + 1 == blocks, 1);
        out.put(2, 2);  // codes of its own
        out.put(0, 5);  // for 257 symbols
        out.put(0, 5);  // and one distance, which does not occur
        out.put(15, 4);
        out.flush();
        // all lengths of codes are equally long, those that stand for repeated lengths do not occur
        for (int k = 0; k < 19; ++k, out.flush()) out.put(k < 3 ? 0 : length_bits, 3);
        for (const Code& code : codes) out.put(reversed(code.length, length_bits), length_bits), out.flush();
        out.put(reversed(1, length_bits), length_bits);
        out.flush();
        int i = 0;
        for (; i + 3 < own.size(); i += 3, out.flush())
            for (int k = 0; k < 3; ++k) out.put(codes[own[i + k]].bits, codes[own[i + k]].length);
        for (; i < own.size(); ++i, out.flush()) out.put(codes[own[i]].bits, codes[own[i]].length);
        out.put(codes.back().bits, codes.back().length);
        out.flush();
    }
    out.put(0, 7);
    out.flush();
    found.shape[0] = static_cast<int>(out.to - found.values.data());
    found.values.resize(found.shape[0]);
    return found;
}

}  // namespace vbaa::simulate
