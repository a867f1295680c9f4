#include "csv_lines.hpp"

#include <charconv>
#include <cmath>

namespace vbaa {
namespace {

void add_word(std::string_view word, std::string& lines) {
    if (word.find_first_of(",\"\r\n") == std::string_view::npos) {
        lines += word;
        return;
    }
    lines += '"';
    for (char each : word) {
        if (each == '"') lines += '"';
        lines += each;
    }
    lines += '"';
}

}  // namespace

std::string csv_lines(ConstMatrix numbers, View<const int, 1> digits,
                      const std::vector<std::vector<std::string_view>>& texts) {
    std::string lines;
    for (int row = 0; row < numbers.shape[0]; ++row) {
        std::size_t text = 0;
        for (int column = 0; column < numbers.shape[1]; ++column) {
            if (column > 0) lines += ',';
            const double value = numbers(row, column);
            if (digits[column] == 0) {
                add_word(texts[text++][row], lines);
            } else if (std::isfinite(value)) {
                char cell[32];  // of up to 17 digits
                lines.append(
                    cell,
                    std::to_chars(cell, cell + sizeof cell, value, std::chars_format::general, digits[column]).ptr);
            }
        }
        lines += '\n';
    }
    return lines;
}

}  // namespace vbaa
