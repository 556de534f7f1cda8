#include "scene/obj_text.h"

#include <algorithm>
#include <charconv>
#include <system_error>

namespace veriray {
namespace {

constexpr size_t kNumbers[3] = {3, 2, 3}, kLeast[3] = {3, 1, 3};  // of v, vt, vn

bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\v' || c == '\f'; }
bool is_digit(char c) { return c >= '0' && c <= '9'; }

// The words of a line, up to a comment.
struct Words {
    const char *at, *end;

    std::string_view next() {
        while (at != end && is_blank(*at)) ++at;
        const char* from = at;
        while (at != end && !is_blank(*at)) ++at;
        return {from, static_cast<size_t>(at - from)};
    }
};

// [+-] digits [. digits] [e [+-] digits], with a digit beside the point.
bool is_number(std::string_view word) {
    const char *p = word.data(), *const end = p + word.size();
    const auto digits = [&] {
        const char* from = p;
        while (p != end && is_digit(*p)) ++p;
        return p - from;
    };
    if (p != end && (*p == '+' || *p == '-')) ++p;
    auto count = digits();
    if (p != end && *p == '.') ++p, count += digits();
    if (!count) return false;
    if (p != end && (*p == 'e' || *p == 'E')) {
        ++p;
        if (p != end && (*p == '+' || *p == '-')) ++p;
        if (!digits()) return false;
    }
    return p == end;
}

template <class T>
bool parse(std::string_view word, T& value) {
    if (word.front() == '+') word.remove_prefix(1);
    const auto [stop, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    return error == std::errc() && stop == word.data() + word.size();
}

bool read_numbers(Words words, size_t kind, std::vector<double>& out) {
    for (size_t k = 0; k < kNumbers[kind]; ++k) {
        const std::string_view word = words.next();
        double value = 0;
        if (word.empty() ? k < kLeast[kind] : !is_number(word) || !parse(word, value)) return false;
        out.push_back(value);
    }
    return true;
}

// Rows of v, vt and vn from "v", "v/vt", "v//vn" or "v/vt/vn"; those from the end are negative.
bool read_corner(std::string_view word, const ObjTables& tables, int64_t (&rows)[3]) {
    for (size_t k = 0; k < 3; ++k) {
        const size_t slash = std::min(word.find('/'), word.size());
        const std::string_view part = word.substr(0, slash);
        const bool last = slash == word.size();
        word.remove_prefix(last ? slash : slash + 1);
        if (!part.empty()) {
            const size_t sign = part[0] == '+' || part[0] == '-';
            if (part.size() == sign || part.size() > sign + 18 || !is_digit(part[sign]))
                return false;
            int64_t index = 0;
            if (!parse(part, index)) return false;
            const auto count = static_cast<int64_t>(tables.lines[k].size() / kNumbers[k]);
            if (index == 0 || index > count || index < -count) return false;
            rows[k] = index > 0 ? index - 1 : index + count;
        } else if (k == 0) {
            return false;
        }
        if (last) return true;
    }
    return false;  // a fourth number
}

bool read_face(Words words, ObjTables& tables) {
    int64_t rows[3] = {-1, -1, -1}, sides = 0;
    for (std::string_view word = words.next(); !word.empty(); word = words.next(), ++sides) {
        if (!read_corner(word, tables, rows)) return false;
        tables.corners.insert(tables.corners.end(), rows, rows + 3);
    }
    tables.sides.push_back(sides);
    return sides >= 3;
}

}  // namespace

bool read_obj(std::string_view text, ObjTables& out) {
    const char *p = text.data(), *const end = p + text.size();
    while (p != end) {
        const char* stop = std::find_if(p, end, [](char c) { return c == '\n' || c == '\r'; });
        Words words{p, std::find(p, stop, '#')};
        p = stop == end ? end : stop + 1;
        const std::string_view kind = words.next();
        if (kind == "f") {
            if (!read_face(words, out)) return false;
        } else if (kind == "v" || kind == "vt" || kind == "vn") {
            const size_t k = kind == "v" ? 0 : kind == "vt" ? 1 : 2;
            if (!read_numbers(words, k, out.lines[k])) return false;
        }
    }
    return true;
}

}  // namespace veriray
