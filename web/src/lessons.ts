// Five lessons of a minute: what is set, what to look at, and what to do.

import type { App } from "./app";
import { figures } from "./panels";

export interface Lesson {
  title: string;
  text: string;
  task: string;
  machine: string;
  set(app: App): void;
  watch: string[]; // ids of what to look at
  done(app: App): boolean;
}

const touched = (app: App) => app.flight?.atStop.some((at) => at > 0) ?? false;

export const LESSONS: Lesson[] = [
  {
    title: "It falls",
    machine: "inteco_ml",
    text: "An electromagnet pulls the harder the nearer the ball is. Where the force just carries the weight there is a balance, but no stable one: a hair upwards and the ball jumps to the pole, a hair downwards and it falls. No constant current holds it.",
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
    text: "A controller measures where the rotor is and changes the current: proportional gain for stiffness, derivative gain for damping. The proportional gain must beat the magnet's own negative stiffness k_s. The sensitivity tells how close the loop is to the edge: below 3 is zone A of ISO 14839-3.",
    task: "Turn the derivative gain down until the peak of |S| leaves zone A, and see the step ring.",
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
    text: "The sensor shows the rotor with noise. The derivative of noise is more noise: the controller shakes the current, and the rotor with it. A filter that knows the machine tells the rotor from the noise.",
    task: "Make the sensor ten times noisier, and let the first filter feed the controller instead of the sensor.",
    set: (app) => {
      app.settings.p.feedback = 0;
    },
    watch: ["error", "knob-noise_y", "choice-feedback"],
    done: (app) => app.settings.p.feedback > 0 && app.settings.p.noise_y > 25 * app.own.p.noise_y,
  },
  {
    title: "What the filter sees",
    machine: "zittau_axial",
    text: "No sensor measures the disturbance force. The filter sees it in how the rotor moves against what the currents should do. Q says how fast it may change: a large Q follows at once and is restless, a small one is calm and late. The innovations show which is right: they should stay within their bounds in 95 of 100 samples.",
    task: "Turn Q down until the lamp is no longer green, then back.",
    set: (app) => {
      app.settings.kinds = [2, 0];
    },
    watch: ["force", "innovation", "knob-Q"],
    done: (app) => app.settings.Q < 0.5,
  },
  {
    title: "What it cannot know",
    machine: "zittau_axial",
    text: "A wrong magnet constant looks like a force. The filter takes the missing pull for a disturbance, and its position can be off too, while its innovations are small: what model and measurement share, no innovation shows. Only the truth does, and here you have it.",
    task: "Let the filters assume k a third too large, and compare the lamp with the error of the force.",
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
