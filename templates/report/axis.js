// The grid on which a threshold moves, and where a value lies on the upright axis.

// The number of a step as the manifest would write it, without ever rounding: a whole number with its point moved.
export const written = (plot, number) => {
  const whole = number * plot.mantissa;
  if (plot.exponent >= 0) return String(whole * 10 ** plot.exponent);
  const places = -plot.exponent;
  const figures = String(whole).padStart(places + 1, "0");
  return `${figures.slice(0, -places)}.${figures.slice(-places)}`.replace(/\.?0+$/, "");
};

export const step = (plot) => plot.mantissa * 10 ** plot.exponent;
export const bounded = (plot, number) => Math.min(Math.max(number, plot.first), plot.last);
const scaled = (plot, value) => (plot.logarithmic ? Math.log10(value) : value);

export const heightOf = (plot, value) => {
  const inside = Math.min(Math.max(value, plot.low), plot.high);
  return (scaled(plot, inside) - scaled(plot, plot.low)) / (scaled(plot, plot.high) - scaled(plot, plot.low));
};

export const valueAt = (plot, height) => {
  const at = scaled(plot, plot.low) + height * (scaled(plot, plot.high) - scaled(plot, plot.low));
  return plot.logarithmic ? 10 ** at : at;
};
