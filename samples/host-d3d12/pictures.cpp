#include "pictures.hpp"

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <sstream>
#include <stdexcept>

#include <windows.h>

static const char not_ppm[] = ": is no PPM with 8 bits (P6). Convert it: magick picture.png picture.ppm";

std::string read_text(const std::string &path)
{
    std::ifstream file(std::filesystem::u8path(path), std::ios::binary);
    std::string text((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
    if (!file.is_open() || file.bad()) throw std::runtime_error(path + ": cannot be read. Is the path right?");
    return text;
}

void write_text(const std::string &path, const std::string &text)
{
    std::ofstream file(std::filesystem::u8path(path), std::ios::binary);
    file.write(text.data(), static_cast<std::streamsize>(text.size()));
    file.close();
    if (!file) throw std::runtime_error(path + ": cannot be written. Is there room, and may this user write there?");
}

image read_ppm(const std::string &path)
{
    const std::string text = read_text(path);
    std::istringstream words(text);
    std::string kind;
    std::uint32_t numbers[3] = {};
    words >> kind;
    for (std::uint32_t &number : numbers) {
        /* Skips a comment, which ends with its line. */
        while ((words >> std::ws).peek() == '#') words.ignore(static_cast<std::streamsize>(text.size()), '\n');
        words >> number;
    }
    const std::uint32_t width = numbers[0], height = numbers[1];
    if (!words || kind != "P6" || numbers[2] != 255 || width < 1 || width > 16384 || height < 1 || height > 16384) {
        throw std::runtime_error(path + not_ppm);
    }
    const std::size_t start = static_cast<std::size_t>(words.tellg()) + 1, count = std::size_t{width} * height;
    if (text.size() < start || text.size() - start < count * 3) throw std::runtime_error(path + not_ppm);
    image made(width, height);
    for (std::size_t i = 0; i < count; i++) {
        for (std::size_t c = 0; c < 3; c++) made.rgba[i * 4 + c] = static_cast<unsigned char>(text[start + i * 3 + c]);
        made.rgba[i * 4 + 3] = 255;
    }
    return made;
}

void write_ppm(const std::string &path, const image &image)
{
    std::string text = "P6\n" + std::to_string(image.width) + " " + std::to_string(image.height) + "\n255\n";
    for (std::size_t i = 0; i < image.rgba.size(); i++) {
        if (i % 4 != 3) text.push_back(static_cast<char>(image.rgba[i]));
    }
    write_text(path, text);
}

void write_ppm_of_ten(const std::string &path, std::uint32_t width, std::uint32_t height, const std::vector<unsigned char> &pixels)
{
    std::string text = "P6\n" + std::to_string(width) + " " + std::to_string(height) + "\n1023\n";
    for (std::size_t i = 0; i < pixels.size(); i += 4) {
        std::uint32_t word;
        std::memcpy(&word, &pixels[i], sizeof word);
        for (int c = 0; c < 3; c++, word >>= 10) {
            text.push_back(static_cast<char>(word >> 8 & 3));
            text.push_back(static_cast<char>(word & 255));
        }
    }
    write_text(path, text);
}

/* A half float, given as its bits, as a single float. */
static float float_of_half(std::uint16_t half)
{
    const int exponent = half >> 10 & 31, fraction = half & 1023;
    float value = std::ldexp(static_cast<float>(fraction), -24);
    if (exponent == 31) value = fraction != 0 ? std::numeric_limits<float>::quiet_NaN() : std::numeric_limits<float>::infinity();
    else if (exponent > 0) value = std::ldexp(static_cast<float>(fraction + 1024), exponent - 25);
    return (half >> 15) != 0 ? -value : value;
}

void write_pfm(const std::string &path, std::uint32_t width, std::uint32_t height, const std::vector<unsigned char> &pixels)
{
    std::string text = "PF\n" + std::to_string(width) + " " + std::to_string(height) + "\n-1.0\n";
    for (std::size_t y = height; y-- > 0;) {
        for (std::size_t i = 0; i < std::size_t{width} * 4; i++) {
            if (i % 4 == 3) continue;
            std::uint16_t half;
            std::memcpy(&half, &pixels[(y * width * 4 + i) * 2], sizeof half);
            const float value = float_of_half(half);
            char bytes[sizeof value];
            std::memcpy(bytes, &value, sizeof value);
            text.append(bytes, sizeof bytes);
        }
    }
    write_text(path, text);
}

void make_folder(const std::string &path)
{
    std::error_code failed;
    std::filesystem::create_directories(std::filesystem::u8path(path), failed);
    if (failed) throw std::runtime_error(path + ": the folder cannot be made: " + failed.message());
}

std::string beside_program(const char *name)
{
    std::wstring path(32768, L'\0');
    path.resize(GetModuleFileNameW(nullptr, &path[0], static_cast<DWORD>(path.size())));
    return (std::filesystem::path(path).parent_path() / name).u8string();
}
