// Entry point of the workbench.

import { Core } from "./core";
import { App } from "./app";
import { RotorCore } from "./rotor_core";
import type { Machine } from "./state";

function bytes(base64: string): Uint8Array<ArrayBuffer> {
  const text = atob(base64.trim()), to = new Uint8Array(text.length);
  for (let k = 0; k < text.length; k++) to[k] = text.charCodeAt(k);
  return to;
}

async function start(): Promise<void> {
  const text = (id: string) => document.getElementById(id)!.textContent ?? "";
  const wasm = bytes(text("wasm")), data = JSON.parse(text("data")) as { machines: Machine[]; models: number[][] };
  const core = async () => Core.of(wasm, data.models), rotor = async () => RotorCore.of(wasm);
  const app = new App(await core(), await core(), await rotor(), await rotor(), data.machines);
  (window as unknown as { workbench: App }).workbench = app;
  document.documentElement.dataset.ready = "yes";
}

start().catch((error: unknown) => {
  const status = document.getElementById("status")!;
  status.className = "wrong";
  status.textContent = `The workbench could not start: ${error instanceof Error ? error.message : String(error)}`;
  throw error;
});
