// Numbers that someone else owns: a pointer and a size.

#ifndef ROBOT_DYNAMICS_CONTROL_ARRAY_VIEW_HPP
#define ROBOT_DYNAMICS_CONTROL_ARRAY_VIEW_HPP

#include <cmath>
#include <cstddef>
#include <type_traits>
#include <vector>

namespace robot_dynamics_control {

/// A view of consecutive numbers, as std::span of C++20. It is valid as long as they are.
template <typename T>
class ArrayView {
public:
    constexpr ArrayView() noexcept = default;
    constexpr ArrayView(T* data, std::size_t size) noexcept : data_(data), size_(size) {}

    template <typename Container, typename = std::enable_if_t<
        !std::is_same_v<std::remove_cv_t<Container>, ArrayView>
        && std::is_convertible_v<decltype(std::declval<Container&>().data()), T*>>>
    constexpr ArrayView(Container& container) noexcept : data_(container.data()), size_(container.size()) {}

    constexpr T& operator[](std::size_t index) const noexcept { return data_[index]; }
    constexpr T* data() const noexcept { return data_; }
    constexpr std::size_t size() const noexcept { return size_; }
    constexpr bool empty() const noexcept { return size_ == 0; }
    constexpr T* begin() const noexcept { return data_; }
    constexpr T* end() const noexcept { return data_ + size_; }

private:
    T* data_ = nullptr;
    std::size_t size_ = 0;
};

using Numbers = ArrayView<const double>;
using MutableNumbers = ArrayView<double>;

/// Index of the first number that is not finite; the size where all are.
inline std::size_t find_not_finite(Numbers values) noexcept
{
    std::size_t index = 0;
    while (index < values.size() && std::isfinite(values[index])) {
        ++index;
    }
    return index;
}

/// Whether all numbers are finite.
inline bool all_finite(Numbers values) noexcept { return find_not_finite(values) == values.size(); }

} // namespace robot_dynamics_control

#endif
