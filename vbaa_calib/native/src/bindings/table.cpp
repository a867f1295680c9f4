// Tables as text.
#include <nanobind/stl/string.h>

#include "csv_lines.hpp"
#include "numpy.hpp"

namespace vbaa {
namespace {

std::string lines(InMatrix numbers, Numpy<const int, 1> digits, nb::list texts) {
    require(digits.shape(0) == numbers.shape(1), "each column has its digits");
    std::size_t words = 0;
    for (int each : view(digits)) {
        require(each >= 0 && each <= 17, "a number has 17 digits at most");
        words += each == 0;
    }
    require(texts.size() == words, "each column without digits has its texts");
    std::vector<std::vector<std::string_view>> columns;
    for (nb::handle column : texts) {
        std::vector<std::string_view> several;
        for (nb::handle each : nb::cast<nb::list>(column)) {
            Py_ssize_t size = 0;
            const char* word = PyUnicode_AsUTF8AndSize(each.ptr(), &size);
            if (word == nullptr) throw nb::python_error();
            several.emplace_back(word, size);
        }
        require(several.size() == numbers.shape(0), "each row has its texts");
        columns.push_back(std::move(several));
    }
    return csv_lines(view(numbers), view(digits), columns);
}

}  // namespace

void bind_table(nb::module_& module) {
    auto room = module.def_submodule("table", "Tables as text.");
    room.def("lines", &lines, "Lines of a CSV table: numbers (B, K), digits (K,), and texts for columns of 0 digits.");
}

}  // namespace vbaa
