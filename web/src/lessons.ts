// Five lessons of a minute: settings, what to observe, and a task.

import type { App } from "./app";
import { figures } from "./panels";

export interface Lesson {
  title: string;
  text: string;
  task: string;
  machine: string;
  set(app: App): void;
  watch: string[]; // ids of elements to observe
  done(app: App): boolean;
}

const touched = (app: App) => app.flight?.atStop.some((at) => at > 0) ?? false;

export const LESSONS: Lesson[] = [
  {
    title: "It falls",
    machine: "inteco_ml",
    text: "The nearer the ball, the harder the magnet pulls. At one distance the pull just carries the weight, but that equilibrium is unstable: a hair above it the ball jumps to the pole, a hair below it falls. No constant current holds the ball.",
    task: "Switch the magnets off and watch it fall. Then switch them on again.",
    set: (app) => {
      app.settings.start = "levitated";
    },
    watch: ["machine-panel"],
    done: (app) => Math.abs(app.motion.now?.x ?? 0) > 0.5 * app.settings.p.clearance,
  },
  {
    title: "A PID holds it",
    machine: "zittau_axial",
    text: "A controller measures the position and changes the current. Proportional gain gives stiffness, derivative gain gives damping. The proportional gain must overcome the magnet's own negative stiffness k_s. The peak of the sensitivity shows how robust the loop is: below 3 it is in zone A of ISO 14839-3.",
    task: "Turn the derivative gain down until the peak of |S| leaves zone A. The step response rings.",
    set: (app) => {
      app.settings.p.feedback = 0;
      app.settings.noisy = false;
    },
    watch: ["response", "sensitivity", "knob-kd"],
    done: (app) => (app.panels.margin?.peak ?? 0) > 3,
  },
  {
    title: "Noise",
    machine: "zittau_axial",
    text: "Every reading contains noise, and its derivative contains more. The controller turns that noise into current, which shakes the rotor. A filter that knows the machine separates the motion from the noise.",
    task: "Make the sensor ten times noisier. Then feed the controller from the first filter instead of the sensor.",
    set: (app) => {
      app.settings.p.feedback = 0;
    },
    watch: ["error", "knob-noise_y", "choice-feedback"],
    done: (app) => app.settings.p.feedback > 0 && app.settings.p.noise_y > 25 * app.own.p.noise_y,
  },
  {
    title: "What the filter sees",
    machine: "zittau_axial",
    text: "No sensor measures the disturbance force. The filter infers it from the difference between the motion it expects and the motion it sees. Q states how fast the force may change: with a large Q the estimate is quick and noisy, with a small Q smooth and late. The innovations show which is right: 95 of 100 should lie within their bounds.",
    task: "Turn Q down until the lamp is no longer green. Then turn it back.",
    set: (app) => {
      app.settings.kinds = [2, 0];
    },
    watch: ["force", "innovation", "knob-Q"],
    done: (app) => app.settings.Q < 0.5,
  },
  {
    title: "What it cannot know",
    machine: "zittau_axial",
    text: "A wrong magnet constant looks like a force. The filter attributes the missing pull to a disturbance, and its innovations stay small. An error that the disturbance estimate can absorb does not show in the innovations; only a comparison with the truth reveals it, and here you have the truth.",
    task: "Let the filters assume a k that is a third too large. Compare the lamp with the error of the force.",
    set: (app) => {
      app.settings.kinds = [2, 1, 0];
    },
    watch: ["force", "innovation", "knob-filter_k"],
    done: (app) => {
      if (!app.flight || app.settings.p.filter_k < 1.25) return false;
      return figures(app.flight, app.flight.filters[0]).f_d > 0.02 * Math.abs(app.settings.p.mass * 9.81) && !touched(app);
    },
  },
];
